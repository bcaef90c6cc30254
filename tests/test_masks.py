"""Masks at the public surface: nothing comes from masked pixels, whatever the method."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import Localizer
from nearfar.arrays import RGBPixels
from nearfar.cli import main
from nearfar.errors import ImageError, SettingsError
from nearfar.models import Answer
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from tests.conftest import KnownPair


def half(pixels: np.ndarray) -> np.ndarray:
    """(height, width) without the left half."""
    mask = np.full(pixels.shape[:2], 255, np.uint8)
    mask[:, : pixels.shape[1] // 2] = 0
    return mask


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("adaptive", {"max_effort": "points"}),
        ("sift-tuned", {}),
        ("orb", {}),
        ("paper", {"descriptor": "hog", "max_size": 400}),
        ("objects", {"descriptor": "hog", "max_size": 400}),
    ],
)
def test_no_match_lies_on_masked_pixels(
    method: str, options: dict[str, Any], known_pair: KnownPair
) -> None:
    localizer = Localizer(method=method, **options)
    whole = localizer.localize(known_pair.far, known_pair.near)
    mask = half(known_pair.near)
    found = localizer.localize(known_pair.far, known_pair.near, near_mask=mask)
    middle = known_pair.near.shape[1] / 2
    limit = middle if method != "objects" else middle / 2  # Centres of boxes of which half is used.
    assert (whole.points.near[:, 0] < limit).any()
    assert len(found.points)
    assert (found.points.near[:, 0] >= limit).all()
    if method != "objects":
        assert known_pair.error(np.asarray(found.far_from_near)) < 3


def test_the_search_finds_a_place_beside_what_the_far_mask_leaves_out(
    known_pair: KnownPair,
) -> None:
    localizer = Localizer(descriptor="hog", max_effort="landmarks")
    height, width = known_pair.far.shape[:2]
    found = localizer.localize(
        known_pair.far,
        known_pair.near,
        far_mask=np.zeros((height, width)) + (np.arange(width) < 150),
    )
    assert not found.localized


def test_transparency_is_a_mask(known_pair: KnownPair) -> None:
    rgba = np.dstack([known_pair.near, half(known_pair.near)])
    found = Localizer(max_effort="points").localize(known_pair.far, rgba)
    assert found.localized
    assert (found.points.near[:, 0] >= known_pair.near.shape[1] / 2).all()


def test_bad_masks_and_methods_without_masks(known_pair: KnownPair) -> None:
    with pytest.raises(ImageError, match="as large as the image"):
        Localizer().localize(known_pair.far, known_pair.near, far_mask=np.ones((4, 4)))
    with pytest.raises(SettingsError, match="takes no masks"):
        Localizer(method="python:tests.test_masks.Maskless").localize(
            known_pair.far, known_pair.near, near_mask=half(known_pair.near)
        )


class Maskless:
    """A method of another package without `masked`."""

    uses_landmarks = False

    def __init__(self, name: str, settings: Settings) -> None:
        """Take no settings."""

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> RGBPixels:  # noqa: ARG002
        return pixels

    def localize(self, *_given: object) -> Answer:
        raise AssertionError("the mask is refused before the method is asked")


def grid(far: RGBPixels, near: RGBPixels) -> tuple[np.ndarray, np.ndarray]:  # noqa: ARG001
    """Matches all over the near image, at the same pixels of the far one."""
    x, y = np.meshgrid(np.arange(0, 300, 10), np.arange(0, 300, 10))
    xy = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    return xy, xy


def test_matches_of_an_external_matcher_are_dropped(known_pair: KnownPair) -> None:
    found = Localizer(method="python:tests.test_masks.grid").localize(
        known_pair.far, known_pair.near, near_mask=half(known_pair.near)
    )
    assert 50 < len(found.points) < 300
    assert (found.points.near[:, 0] >= known_pair.near.shape[1] / 2).all()


def test_on_the_command_line(
    known_files: tuple[Path, Path],
    known_pair: KnownPair,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    far, near = map(str, known_files)
    PillowImage.fromarray(half(known_pair.near)).save(tmp_path / "mask.png")
    options = ["--near-mask", str(tmp_path / "mask.png"), "--max-effort", "points", "--json"]
    assert main(["localize", far, near, *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["agreement"] > 0.9
    assert found["excluded"] is None
    assert main(["localize", far, near, "--far-mask", far + ".missing"]) == 2
    assert "mask" in capsys.readouterr().err
