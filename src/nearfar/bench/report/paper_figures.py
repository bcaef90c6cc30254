"""The figures of the paper, drawn from results."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.bench.figures import plot_kitti, plot_pairs
from nearfar.bench.paper_tables import mean_log_ste
from nearfar.bench.results import Result
from nearfar.bench.summary import by_method
from nearfar.imaging.image import read_image
from nearfar.render.plotting import figure_axes, save_figure

TOP = 3
"""Number of configurations that figures show beside SIFT, those of the least mean ln STE."""
SAMPLES = (1, 5, 10)
"""Values of j of the sample frames of KITTI."""
STEPS = (
    ("images", "far and near"),
    ("object proposals", "Selective Search"),
    ("descriptors", "a layer of ResNet-50"),
    ("landmark matches", "cosine,\ncross-checked"),
    ("SIFT in these boxes", "Euclidean,\ncross-checked"),
    ("RANSAC", "homography or pose"),
)
"""Steps of the method and what each of them is."""


def plot_architecture(folder: Path) -> Path:
    """Draw the steps of the method as boxes from left to right.

    Returns:
        The file written, PNG.
    """
    figure, axes = figure_axes(9, 0.9)
    axes.set_axis_off()
    for index, (name, how) in enumerate(STEPS):
        box = {"boxstyle": "round,pad=0.5", "facecolor": f"C{index % 3}", "alpha": 0.2}
        axes.text(index, 0.5, f"{name}\n{how}", ha="center", va="center", fontsize=7, bbox=box)
        if index:
            arrow = {"arrowstyle": "->", "color": "grey"}
            axes.annotate("", (index - 0.43, 0.5), (index - 0.57, 0.5), arrowprops=arrow)
    axes.set(xlim=(-0.5, len(STEPS) - 0.5), ylim=(0, 1))
    return save_figure(figure, folder / "architecture.png")


def plot_samples(results: Sequence[Result], folder: Path) -> list[Path]:
    """Show a frame of KITTI and its successors at j = 1, 5 and 10; nothing where they are missing.

    Returns:
        The files written, PNG.
    """
    by_far: dict[Path, dict[int, Result]] = {}
    for each in results:
        if each.far is not None and each.near is not None and "j" in each.tags:
            by_far.setdefault(each.far, {})[int(each.tags["j"])] = each
    whole = [far for far, own in by_far.items() if own.keys() >= set(SAMPLES)]
    if not whole:
        return []
    far = whole[len(whole) // 2]
    own = {j: by_far[far][j] for j in SAMPLES}
    names = [f"frame i + {j}, {each.distance or 0:.0f} m further" for j, each in own.items()]
    shown = [("frame i", far), *zip(names, (Path(str(e.near)) for e in own.values()), strict=True)]
    figure, first_axes = figure_axes(7, 2.1 * len(shown))
    first_axes.remove()
    for index, (title, path) in enumerate(shown):
        axes = figure.add_subplot(len(shown), 1, index + 1)
        axes.imshow(read_image(path).pixels)
        axes.set_title(title, fontsize=8)
        axes.set_axis_off()
    return [save_figure(figure, folder / "kitti_samples.png")]


def best_configurations(results: Sequence[Result], count: int = TOP) -> list[str]:
    """Return the methods with landmarks of the least mean ln STE, best first.

    Args:
        results: results of image pairs.
        count: how many.
    """
    means = {
        method: mean_log_ste(own)
        for method, own in by_method(results).items()
        if own[0].row.get("descriptor") is not None
    }
    return sorted(means, key=lambda method: means[method])[:count]


def plot_best(results: Sequence[Result], folder: Path) -> Path:
    """Draw ln STE against scale change for SIFT and the best configurations, with straight lines.

    Returns:
        The file written, PNG.
    """
    shown = _with_sift(results)
    return plot_pairs([each for each in results if each.method in shown], folder)


def _with_sift(results: Sequence[Result]) -> list[str]:
    sift = [method for method in by_method(results) if method.split(" ")[0] == "sift"]
    return [*sift, *best_configurations(results)]


def plot_mappings(results: Sequence[Result], folder: Path) -> list[Path]:
    """Warp far images into near ones by the homographies of SIFT and the best configurations.

    Pairs are that of the largest scale change, and that of the largest on which SIFT is incorrect.

    Returns:
        The files written, PNG.
    """
    methods = _with_sift(results)
    by_case: dict[str, dict[str, Result]] = {}
    for each in results:
        by_case.setdefault(each.case, {})[each.method] = each
    whole = [own for own in by_case.values() if own.keys() >= set(methods)]
    whole.sort(key=lambda own: own[methods[0]].true_scale_change or 0.0, reverse=True)
    failed = [own for own in whole if not own[methods[0]].strict]
    named = {"mapping_largest": whole[:1], "mapping_where_sift_fails": failed[:1]}
    return [
        _plot_mapping(own[0], methods, folder / f"{name}.png") for name, own in named.items() if own
    ]


def _plot_mapping(own: dict[str, Result], methods: Sequence[str], file: Path) -> Path:
    first = own[methods[0]]
    far, near = (read_image(str(path)) for path in (first.far, first.near))
    panels: list[tuple[str, RGBPixels | None]] = [("far", far.pixels), ("near", near.pixels)]
    for method in methods:
        result = own[method]
        matrix = result.homography
        seen = None
        if matrix is not None:
            size = near.width, near.height
            seen = far_in_near(far.pixels, np.array(matrix, np.float64), size)
        error = "no homography" if result.error is None else f"{result.error:,.1f} px off"
        panels.append((f"{method}: {error}", seen))
    columns = 3
    rows = -(-len(panels) // columns)
    figure, first_axes = figure_axes(3.4 * columns, 2.8 * rows)
    first_axes.remove()
    for index, (title, pixels) in enumerate(panels):
        axes = figure.add_subplot(rows, columns, index + 1)
        if pixels is not None:
            axes.imshow(pixels)
        axes.set_title(title, fontsize=7)
        axes.set_axis_off()
    figure.suptitle(f"{first.case}, scale change {first.true_scale_change or 0:.1f}", fontsize=9)
    return save_figure(figure, file)


def far_in_near(far: RGBPixels, far_from_near: Matrix3, size: tuple[int, int]) -> RGBPixels:
    """Return the far image as a homography puts it into the near one, white where it is not.

    A horizon in the image does not matter: each near pixel takes what it is mapped to.

    Args:
        far: the far image.
        far_from_near: homography, pixels of the near image to pixels of the far one.
        size: width and height of the near image.
    """
    flags: Any = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    white = (255, 255, 255)
    return np.asarray(
        cv2.warpPerspective(far, far_from_near, size, flags=flags, borderValue=white), np.uint8
    )


def draw_figures(
    pairs: Sequence[Result], frames: Sequence[Result], folder: Path
) -> dict[str, list[Path]]:
    """Draw every figure that the results allow; the titles are those of the report.

    Args:
        pairs: results of image pairs; may be empty.
        frames: results of KITTI; may be empty.
        folder: where to write.
    """
    figures = {"The method": [plot_architecture(folder)]}
    if frames:
        figures["Frames of KITTI"] = plot_samples(frames, folder)
        figures["Errors and failures against distance"] = plot_kitti(frames, folder)
    if pairs:
        figures["Transfer error of each pair"] = [plot_best(pairs, folder)]
        figures["Far images mapped into near ones"] = plot_mappings(pairs, folder)
    return {title: files for title, files in figures.items() if files}
