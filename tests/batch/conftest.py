"""A folder with a far image, many close-ups of it, and some files that are damaged."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels

COUNT, BAD = 30, (3, 8, 14, 21, 29)
"""Number of pairs, and which of them have a damaged close-up."""


@dataclass(frozen=True)
class Batch:
    """Files of a batch.

    Attributes:
        folder: of the images and the list.
        far: the far image.
        near: the close-ups, with the damaged ones.
        pairs: list of the pairs.
    """

    folder: Path
    far: Path
    near: list[Path]
    pairs: Path


@pytest.fixture(scope="session")
def batch(
    photograph: Callable[[str], RGBPixels], tmp_path_factory: pytest.TempPathFactory
) -> Batch:
    """Thirty close-ups, three times enlarged, five of them damaged; tests must not change it."""
    folder = tmp_path_factory.mktemp("batch")
    pixels = photograph("astronaut")
    far = folder / "far.png"
    PillowImage.fromarray(pixels).save(far)
    rng = np.random.default_rng(0)
    near = []
    for number in range(COUNT):
        x, y = rng.integers(100, 280, 2)
        window = np.ascontiguousarray(pixels[y : y + 110, x : x + 130])
        enlarged = cv2.resize(window, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
        file = folder / "near" / f"{number:02}.png"
        file.parent.mkdir(exist_ok=True)
        PillowImage.fromarray(np.asarray(enlarged)).save(file)
        if number in BAD:
            file.write_bytes(file.read_bytes()[:200])
        near.append(file)
    pairs = folder / "pairs.csv"
    lines = [f"far.png,near/{file.name}" for file in near]
    pairs.write_text("\n".join(["far,near", *lines]) + "\n")
    return Batch(folder, far, near, pairs)
