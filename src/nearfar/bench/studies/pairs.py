"""The experiment on image pairs: the pairs at the size of the paper's images."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage

from nearfar.arrays import Coordinates
from nearfar.bench.datasets.cases import Case
from nearfar.errors import ImageError
from nearfar.geometry.homography import scale_change
from nearfar.imaging.image import read_image
from nearfar.storage.locations import replaced

PAPER_SIZE = (1200, 900)
"""Width and height to which the paper resizes its images (bilinearly, whatever their shape)."""


def resized_to_paper(cases: Sequence[Case], folder: Path) -> list[Case]:
    """The cases with images of 1200x900, written as PNG, and true points and scale change in these.

    A case whose images cannot be read stays as it is, so that its run reports that.
    """
    return [_resized(case, folder) for case in cases]


def _resized(case: Case, folder: Path) -> Case:
    try:
        far, far_points = _write(case.far, case.far_points, folder / case.name / "far.png")
        near, near_points = _write(case.near, case.near_points, folder / case.name / "near.png")
    except ImageError:
        return case
    return dataclasses.replace(
        case,
        far=far,
        near=near,
        scale_change=scale_change(far_points, near_points),
        far_points=far_points,
        near_points=near_points,
    )


def _write(source: Path, points: Coordinates, file: Path) -> tuple[Path, Coordinates]:
    """The resized image's file and the points in its pixels."""
    image = read_image(source)
    factor = np.array(PAPER_SIZE) / (image.width, image.height)
    file.parent.mkdir(parents=True, exist_ok=True)
    pixels = cv2.resize(image.pixels, PAPER_SIZE, interpolation=cv2.INTER_LINEAR)
    with replaced(file) as incomplete:
        PillowImage.fromarray(pixels).save(incomplete, format="PNG")
    return file, (points + 0.5) * factor - 0.5
