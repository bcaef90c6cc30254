"""The experiment on image pairs: its summary and its plots."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage

from nearfar.arrays import Coordinates
from nearfar.bench.datasets.cases import Case
from nearfar.bench.tables import distinct, markdown, method_name
from nearfar.errors import ImageError
from nearfar.geometry.homography import scale_change
from nearfar.imaging.image import read_image
from nearfar.render.plotting import figure_axes, save_figure
from nearfar.storage.locations import replaced
from nearfar.storage.rows import Row

PAPER_TABLE_III = {"SIFT (paper)": 10.654, "res3d, 64 (paper's best)": 9.339}
"""Mean natural logarithm of the symmetric transfer error of 31 pairs (paper, Table III)."""


def log_ste(row: Row, column: str = "ste") -> float:
    """Natural logarithm of a symmetric transfer error; minus infinity for a perfect answer."""
    value = row[column]
    return math.log(value) if value > 0 else -math.inf


def table_three(rows: Sequence[Row]) -> str:
    """Markdown: per method mean logarithms, failures, and the answers' median error per point."""
    header = [
        "method",
        "pairs",
        "mean ln STE",
        "mean ln STE, published code",
        "failures",
        "median error per point",
    ]
    rows = [row for row in rows if row["model"] == "homography"]
    lines = []
    for method in distinct(method_name(row) for row in rows):
        own = [row for row in rows if method_name(row) == method]
        errors = [row["median_error"] for row in own if row["median_error"] is not None]
        lines.append(
            [
                method,
                str(len(own)),
                f"{np.mean([log_ste(row) for row in own]):.3f}",
                f"{np.mean([log_ste(row, 'ste_published') for row in own]):.3f}",
                str(sum(row["status"] != "localized" for row in own)),
                f"{np.median(errors):.2f} px" if errors else "",
            ]
        )
    for method, value in PAPER_TABLE_III.items():
        lines.append([method, "31", "", f"{value:.3f}", "", ""])
    return markdown(header, lines)


def plot_pairs(rows: Sequence[Row], folder: Path) -> Path:
    """One point a pair and method, and a best-fit line a method.

    Returns:
        The file written, PNG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = figure_axes()
    shown = [row for row in rows if row["model"] == "homography" and row["true_scale_change"]]
    for index, method in enumerate(distinct(method_name(row) for row in shown)):
        own = [row for row in shown if method_name(row) == method]
        scale = np.array([row["true_scale_change"] for row in own])
        error = np.array([log_ste(row) for row in own])
        axes.plot(scale, error, "o", color=f"C{index}", label=method, markersize=4, alpha=0.7)
        finite = np.isfinite(error)
        if len(np.unique(scale[finite])) > 1:
            slope, start = np.polyfit(scale[finite], error[finite], 1)
            ends = np.array([scale.min(), scale.max()])
            axes.plot(ends, start + slope * ends, color=f"C{index}", linewidth=1.5)
    axes.set_xlabel("scale change")
    axes.set_ylabel("ln of the symmetric transfer error")
    axes.legend()
    return save_figure(figure, folder / "pairs_ste.png")


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
