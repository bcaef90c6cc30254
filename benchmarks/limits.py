"""Where localization ends: one real pair, made harder in one respect at a time until it fails.

    python benchmarks/limits.py PAIR OUT [--method adaptive] [--descriptor nearfar]

PAIR is a folder with a `pair.json` whose model is a homography. Writes OUT/limits.jsonl and
OUT/limits.png, the last success and the first failure of each row, and prints a table.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

from nearfar import Localizer
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.image import read_image

RIGHT = 3.0
"""Mean error of a success, in pixels of the original far image."""
LARGEST = 10_000
"""Sides up to this are not reduced when the pair is read, in pixels."""


@dataclass(frozen=True, eq=False)
class Harder:
    """A pair in which one respect was changed.

    Attributes:
        far: its far image.
        near: its near image.
        far_from_original: maps the original far image to `far`.
        near_from_original: the same of the near image.
    """

    far: RGBPixels
    near: RGBPixels
    far_from_original: Matrix3
    near_from_original: Matrix3


@dataclass(frozen=True)
class Row:
    """What came of it.

    Attributes:
        change: what was changed.
        amount: how much.
        status: of the localization.
        error: mean distance of the true points, in pixels of the original far image.
        confidence: that the localizer has.
        step: that decided.
    """

    change: str
    amount: float
    status: str
    error: float | None
    confidence: float | None
    step: str | None

    @property
    def right(self) -> bool:
        """Whether it is a success."""
        return self.status == "localized" and self.error is not None and self.error < RIGHT


def smaller_far(far: RGBPixels, near: RGBPixels, amount: float) -> Harder:
    """The far image from further away: the scale change grows."""
    reduced, matrix = _resized(far, 1 / amount, 1 / amount)
    return Harder(reduced, near, matrix, np.eye(3))


def foreshortened(far: RGBPixels, near: RGBPixels, amount: float) -> Harder:
    """The near image from aside: reduced in one direction."""
    reduced, matrix = _resized(near, 1 / amount, 1.0)
    return Harder(far, reduced, np.eye(3), matrix)


def blurred(far: RGBPixels, near: RGBPixels, amount: float) -> Harder:
    """The near image out of focus: `amount` is the standard deviation in near pixels."""
    return Harder(far, np.asarray(cv2.GaussianBlur(near, (0, 0), amount)), np.eye(3), np.eye(3))


def hidden(far: RGBPixels, near: RGBPixels, amount: float) -> Harder:
    """The near image but for its middle, of which only the share 1 - `amount` is left."""
    height, width = near.shape[:2]
    half = np.sqrt(1 - amount) / 2
    seen = np.full_like(near, 128)
    top, left = int(height * (0.5 - half)), int(width * (0.5 - half))
    inside = np.s_[top : height - top, left : width - left]
    seen[inside] = near[inside]
    return Harder(far, seen, np.eye(3), np.eye(3))


def darkened(far: RGBPixels, near: RGBPixels, amount: float) -> Harder:
    """The near image at night: `amount` times darker, with the noise of the sensor."""
    noise = np.random.default_rng(0).normal(0, 2, near.shape)
    dark = np.clip(near / amount + noise, 0, 255).astype(np.uint8)
    return Harder(far, dark, np.eye(3), np.eye(3))


CHANGES: dict[str, tuple[Callable[[RGBPixels, RGBPixels, float], Harder], tuple[float, ...]]] = {
    "far image smaller": (smaller_far, (1, 2, 3, 4, 6, 8)),
    "near image foreshortened": (foreshortened, (2, 4, 8, 12, 16, 24)),
    "near image blurred (px)": (blurred, (5, 10, 20, 40)),
    "near image hidden (share)": (hidden, (0.5, 0.75, 0.9, 0.95, 0.98)),
    "near image darker": (darkened, (4, 8, 16, 32, 64)),
}


def main() -> None:
    """Make the pair harder and harder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pair", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--method", default="adaptive")
    parser.add_argument("--descriptor", default="nearfar")
    arguments = parser.parse_args()
    (case,) = find_pairs(arguments.pair)
    far, near = (read_image(file, max_size=LARGEST).pixels for file in (case.far, case.near))
    localizer = Localizer(method=arguments.method, descriptor=arguments.descriptor)
    arguments.out.mkdir(parents=True, exist_ok=True)
    shown: list[tuple[Row, Harder]] = []
    with (arguments.out / "limits.jsonl").open("w", encoding="utf-8") as log:
        for name, (change, amounts) in CHANGES.items():
            before: tuple[Row, Harder] | None = None
            for amount in amounts:
                harder = change(far, near, amount)
                row = _located(localizer, case, harder, name, amount)
                log.write(json.dumps(asdict(row)) + "\n")
                print(row)
                if not row.right:
                    shown += [*([before] if before else []), (row, harder)]
                    break
                before = row, harder
    _draw(shown, case, arguments.out / "limits.png")


def _located(localizer: Localizer, case: Case, harder: Harder, change: str, amount: float) -> Row:
    found = localizer.localize(harder.far, harder.near, model="homography")
    error = None
    if isinstance(found.far_from_near, np.ndarray):
        near = transform(harder.near_from_original, np.array(case.near_points))
        far = transform(
            np.linalg.inv(harder.far_from_original), transform(found.far_from_near, near)
        )
        error = float(np.linalg.norm(far - case.far_points, axis=1).mean())
    return Row(change, amount, found.status, error, found.confidence, found.step)


def _resized(pixels: RGBPixels, across: float, down: float) -> tuple[RGBPixels, Matrix3]:
    height, width = pixels.shape[:2]
    size = max(1, round(width * across)), max(1, round(height * down))
    resized = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return np.asarray(resized), scaling(size[0] / width, size[1] / height)


def _draw(shown: list[tuple[Row, Harder]], case: Case, file: Path) -> None:
    """Two answers a line, each as the place in the far image and the near image."""
    lines = -(-len(shown) // 2)
    figure, axes = plt.subplots(lines, 4, figsize=(10, 2.1 * lines), squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for (row, harder), (left, right) in zip(shown, axes.reshape(-1, 2), strict=False):
        answer = "refused" if row.error is None else f"{row.error:.1f} px off"
        left.set_title(f"{row.change} {row.amount:g}: {answer}", fontsize=8, loc="left")
        left.imshow(_place(harder, case), interpolation="nearest")
        right.imshow(harder.near)
    figure.tight_layout()
    figure.savefig(file, dpi=90)


def _place(harder: Harder, case: Case) -> RGBPixels:
    """The part of the far image around the true points."""
    points = transform(harder.far_from_original, np.array(case.far_points))
    border = 0.15 * np.ptp(points, axis=0)
    left, top = np.maximum(points.min(axis=0) - border, 0).astype(int)
    right, bottom = (points.max(axis=0) + border).astype(int) + 1
    return harder.far[top:bottom, left:right]


if __name__ == "__main__":
    main()
