"""The paper's Table I, its Table III by layer and size, and the percentages of its text."""

import csv
import re
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nearfar.bench.published import (
    PAPER_TABLE_III,
    Comparison,
    Line,
    mean_text,
    unlike_kitti,
    unlike_montreal,
    verdict_on,
)
from nearfar.bench.results import Result
from nearfar.bench.summary import DASH, by_method, measured, summarize
from nearfar.bench.tables import log_ste
from nearfar.errors import BenchmarkError
from nearfar.networks import resnet50

BOLD = {
    128: ("res5c", "pool5"),
    64: ("res4f", "res5c", "pool5"),
    32: ("res3d", "res4f", "res5c", "pool5"),
}
"""Cells of Table I in bold, by the side of the crops: a stage lost its stride there."""


def table_one() -> Comparison:
    """Return the paper's Table I: the lengths of descriptors, as this package computes them."""
    columns = {size: resnet50.lengths(size) for size in resnet50.SIZES}
    lines = []
    for tap in resnet50.TAPS:
        cells = []
        for size, found in columns.items():
            text = f"{found[tap]:,}"
            cells.append(f"**{text}**" if tap in BOLD.get(size, ()) else text)
        lines.append(Line(tap, False, tuple(cells)))
    return Comparison(
        "The paper's Table I",
        "Values of each layer of ResNet-50 for a crop, by its side in pixels. Bold: the authors "
        "removed the stride of a stage.",
        tuple(f"{size} px" for size in columns),
        tuple(lines),
        first="layer",
    )


_TAP = re.compile(r"(?P<network>\w+)-(?P<layer>\w+)@(?P<size>\d+)")
Cells = Mapping[tuple[str, int], float]
"""Mean ln STE by layer and side of the crops."""
PAPER_GRID: Cells = {("res3d", 64): 9.339}
"""Cells of the paper's Table III at hand. The other 23 can be read from a file, `read_cells`."""


def read_cells(file: Path) -> Cells:
    """Read cells of the paper's Table III from CSV: `layer,224,128,64,32`, then a line a layer.

    Raises:
        BenchmarkError: the file cannot be read, or a column or a cell is no number.
    """
    cells: dict[tuple[str, int], float] = {}
    try:
        with file.open(encoding="utf-8", newline="") as text:
            for row in csv.DictReader(text):
                layer = row.pop("layer").strip()
                cells |= {(layer, int(size)): float(value) for size, value in row.items() if value}
    except (OSError, UnicodeDecodeError, KeyError, ValueError, TypeError) as error:
        raise BenchmarkError(
            f"{file} cannot be read as cells of Table III ({error}): the first line must be "
            f"layer,224,128,64,32, and each further line a layer with numbers"
        ) from error
    return cells


def table_three_grid(
    results: Sequence[Result], method: str, printed: Cells = PAPER_GRID
) -> Comparison | None:
    """Return Table III as the paper has it: mean ln STE by layer and size; None without layers.

    Args:
        results: results of image pairs.
        method: "paper", or "objects" for the objects alone.
        printed: cells of the paper's table, which are of the proposed method.
    """
    cells: dict[tuple[str, int], list[Result]] = {}
    for each in results:
        tap = _TAP.fullmatch(str(each.row.get("descriptor")))
        if tap and each.row["method"] == method and "ste" in each.measures:
            cells.setdefault((tap["layer"], int(tap["size"])), []).append(each)
    if not cells:
        return None
    layers, sizes = dict.fromkeys(layer for layer, _ in cells), dict.fromkeys(s for _, s in cells)
    means = {cell: mean_log_ste(own) for cell, own in cells.items()}
    least = min(means.values())
    lines = []
    for layer in layers:
        texts = []
        for size in sizes:
            value = means.get((layer, size))
            text = DASH if value is None else f"{value:.3f}"
            texts.append(f"**{text}**" if value == least else text)
        lines.append(Line(layer, False, tuple(texts)))
    sift = [each for each in results if each.method.startswith("sift") and "ste" in each.measures]
    if sift:
        lines.append(Line("SIFT alone", False, (f"{mean_log_ste(sift):.3f}",) * len(sizes)))
    lines.append(
        Line("SIFT (paper)", True, (f"{PAPER_TABLE_III['SIFT (paper)']:.3f}",) * len(sizes))
    )
    shown = printed if method == "paper" else {}
    for layer in dict.fromkeys(layer for layer, _ in shown):
        values = [printed.get((layer, size)) for size in sizes]
        known = tuple(DASH if value is None else f"{value:.3f}" for value in values)
        lines.append(Line(f"{layer} (paper)", True, known))
    own = [each for of_cell in cells.values() for each in of_cell]
    return Comparison(
        f"The paper's Table III, {'proposed method' if method == 'paper' else 'objects alone'}",
        f"{verdict_on(_unlike_cells(own, cells))} Mean ln STE; the least is bold.",
        tuple(f"{size} px" for size in sizes),
        tuple(lines),
        first="layer",
    )


def _unlike_cells(own: Sequence[Result], cells: dict[tuple[str, int], list[Result]]) -> str | None:
    """Return in what a grid is not the paper's."""
    if not all(str(each.row.get("descriptor")).startswith("resnet50") for each in own):
        return "another network stands in for ResNet-50"
    return next(filter(None, map(unlike_montreal, cells.values())), None)


def mean_log_ste(results: Sequence[Result]) -> float:
    """Return the mean natural logarithm of the symmetric transfer error."""
    return float(np.mean([log_ste(each) for each in results]))


PERCENTAGES = {"t_err": 6, "r_err": 43, "failures": 58}
"""By how many percent the proposed method lowers each of SIFT's values (paper, section IV)."""


def percentages(results: Sequence[Result]) -> Comparison | None:
    """Return by how much the method `paper` lowers the errors of `sift`; None without both.

    The last column is the share of pairs in which its error of rotation is smaller.
    """
    methods = by_method(results)
    if "sift" not in methods:
        return None
    sift = methods["sift"]
    stereo = bool(measured(sift, "t_err_stereo"))
    column = "t_err_stereo" if stereo else "t_err_length"
    by_case = {each.case: each for each in sift}
    lines = [Line("proposed (paper)", True, (*(f"{v} %" for v in PERCENTAGES.values()), DASH))]
    for method, own in methods.items():
        if method == "sift" or not method.startswith(("paper", "objects")):
            continue
        wins = [
            each.measures["r_err"] < by_case[each.case].measures["r_err"]
            for each in own
            if each.case in by_case
        ]
        cells = (
            *(
                _lower(
                    statistics.fmean(measured(sift, name)), statistics.fmean(measured(own, name))
                )
                for name in (column, "r_err")
            ),
            _lower(summarize(sift).unanswered.count, summarize(own).unanswered.count),
            mean_text(statistics.fmean, [100.0 * win for win in wins], ".0f", " %"),
        )
        lines.append(Line(method, False, cells))
    length = "stereo" if stereo else "the truth, since there is no right image"
    return Comparison(
        "The percentages of the paper's text",
        f"{verdict_on(unlike_kitti(results))} By how much each value is below that of SIFT; "
        f"below 0 it is larger. The length of the translation is from {length}.",
        ("t_err", "r_err", "failures", "smaller r_err, share of pairs"),
        tuple(lines),
    )


def _lower(before: float, after: float) -> str:
    return f"{100 * (before - after) / before:.0f} %" if before else DASH


def _mean(results: Sequence[Result], name: str) -> float:
    return statistics.fmean(measured(results, name))
