"""Cards of the narrowest failures and the hardest successes, with their images."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from nearfar.bench.results import Benchmark, Result
from nearfar.bench.summary import by_group, by_method
from nearfar.errors import ImageError
from nearfar.geometry.homography import footprint
from nearfar.imaging.image import read_image
from nearfar.imaging.overlap import polygon_intersection, rectangle

MOST_CARDS = 120
"""Largest number of cards in a report, so that the page stays small."""

_LONGEST = 400
_QUALITY = 74
_FAILURES, _SUCCESSES = 2, 1
"""Largest numbers of cards of a method in a group."""


@dataclass(frozen=True)
class Picture:
    """A thumbnail.

    Attributes:
        name: unique on the page.
        width: width of the original in pixels.
        height: height of the original in pixels.
        data: the thumbnail as a data URI.
    """

    name: str
    width: int
    height: int
    data: str


@dataclass(frozen=True, eq=False)
class Card:
    """A result with its pictures.

    Attributes:
        result: the result shown.
        far: the far image; None where it is missing.
        near: the near image; None where it is missing.
        outline: outline of the near image in pixels of the far image, for an SVG polygon; empty
            without a homography.
        note: why no outline is visible; empty where one is.
    """

    result: Result
    far: Picture | None
    near: Picture | None
    outline: str
    note: str


class Gallery:
    """Makes cards; an image that several cards show is read and stored once."""

    def __init__(self) -> None:
        self._pictures: dict[Path, Picture | None] = {}

    @property
    def pictures(self) -> list[Picture]:
        """Return all thumbnails that cards have used so far."""
        return [picture for picture in self._pictures.values() if picture is not None]

    def cards(self, benchmark: Benchmark, most: int) -> dict[str, list[Card]]:
        """Return at most `most` cards for each method, sorted by group."""
        return {
            method: [self._card(result) for result in chosen(results, most)]
            for method, results in by_method(benchmark.results).items()
        }

    def _card(self, result: Result) -> Card:
        far, near = self._picture(result.far), self._picture(result.near)
        if result.homography is None or far is None or near is None:
            return Card(result, far, near, "", "")
        corners = footprint(np.array(result.homography, np.float64), near.width, near.height)
        if corners is None:
            return Card(result, far, near, "", "The outline reaches infinity.")
        visible = polygon_intersection(
            corners, rectangle(-far.width, -far.height, 2 * far.width, 2 * far.height)
        )
        inside = polygon_intersection(corners, rectangle(0, 0, far.width - 1, far.height - 1))
        outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in visible)
        note = "" if len(inside) else "The outline lies outside the far image."
        return Card(result, far, near, outline, note)

    def _picture(self, path: Path | None) -> Picture | None:
        if path is None:
            return None
        if path not in self._pictures:
            self._pictures[path] = _thumbnail(path, f"picture-{len(self._pictures)}")
        return self._pictures[path]


def chosen(results: Sequence[Result], most: int) -> list[Result]:
    """Choose the narrowest failures and the hardest successes of each group, at most `most` in all.

    Failures with the smallest error come first, and failures without an answer last. Successes are
    sorted by falling scale change, or else by falling error.
    """
    ranked: list[tuple[int, Result]] = []
    for of_group in by_group(results).values():
        failures = sorted((r for r in of_group if not r.strict), key=_margin)[:_FAILURES]
        successes = sorted((r for r in of_group if r.strict), key=_ease)[:_SUCCESSES]
        interleaved = [*failures[:1], *successes, *failures[1:]]
        ranked.extend(enumerate(interleaved))
    kept = sorted(ranked, key=lambda item: item[0])[:most]
    return [r for of_group in by_group(r for _, r in kept).values() for r in of_group]


def _margin(result: Result) -> tuple[bool, float]:
    return (True, 0.0) if result.error is None else (False, result.error)


def _ease(result: Result) -> tuple[float, float]:
    return -(result.true_scale_change or 0.0), -(result.error or 0.0)


def _thumbnail(path: Path, name: str) -> Picture | None:
    try:
        image = read_image(path, max_size=_LONGEST)
    except ImageError:
        return None
    buffer = io.BytesIO()
    PillowImage.fromarray(image.pixels).save(buffer, "JPEG", quality=_QUALITY, optimize=True)
    data = base64.b64encode(buffer.getvalue()).decode()
    return Picture(name, image.width, image.height, f"data:image/jpeg;base64,{data}")
