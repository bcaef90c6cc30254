"""The study of image pairs, also at the size of the paper's images."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage

from nearfar.arrays import Coordinates
from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_pairs
from nearfar.bench.published import table_three
from nearfar.bench.results import Result
from nearfar.bench.study import STUDIES, Study
from nearfar.bench.tables import risk_table, success_table, time_table
from nearfar.errors import ImageError
from nearfar.geometry.homography import scale_change
from nearfar.imaging.image import read_image
from nearfar.storage.locations import replaced


@STUDIES.register("pairs")
class Pairs(Study):
    """Image pairs with corresponding points."""

    def cases(self, folder: Path) -> list[Case]:
        """See `Study.cases`."""
        return find_pairs(folder)

    def tables(self, results: Sequence[Result]) -> dict[str, str]:
        """See `Study.tables`."""
        limit = self.settings.max_false_alarms
        return {
            "Successes, strict / loose": success_table(results),
            "Symmetric transfer error of the pairs with a homography (the paper's Table III)": (
                table_three(results).markdown()
            ),
            "Share of incorrect answers (strict), at the share of pairs answered": (
                risk_table(results, limit)
            ),
            "Median seconds by stage, where it ran": time_table(results),
        }

    def plots(self, results: Sequence[Result], folder: Path) -> list[Path]:
        """See `Study.plots`."""
        return [plot_pairs(results, folder)]


PAPER_SIZE = (1200, 900)
"""Width and height in pixels to which the paper resizes its images, whatever their shape."""


def resized_to_paper(cases: Sequence[Case], folder: Path) -> list[Case]:
    """Resize the images of cases to 1200x900, with their true points and scale changes.

    A case whose images cannot be read stays as it is; its run reports the error.

    Args:
        cases: the cases.
        folder: folder for the resized images, PNG.
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
        tags={**case.tags, "size": "x".join(map(str, PAPER_SIZE))},
    )


def _write(source: Path, points: Coordinates, file: Path) -> tuple[Path, Coordinates]:
    """Write a resized image; return its file and the points in its pixels."""
    image = read_image(source)
    factor = np.array(PAPER_SIZE) / (image.width, image.height)
    file.parent.mkdir(parents=True, exist_ok=True)
    pixels = cv2.resize(image.pixels, PAPER_SIZE, interpolation=cv2.INTER_LINEAR)
    with replaced(file) as incomplete:
        PillowImage.fromarray(pixels).save(incomplete, format="PNG")
    return file, (points + 0.5) * factor - 0.5
