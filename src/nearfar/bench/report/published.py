"""The paper's own results beside ours (Table II, Table III)."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from nearfar.bench.report.load import Benchmark, Result
from nearfar.bench.report.summary import DASH, by_method, is_pose, measured

KITTI_PAIRS = range(40_000, 42_000)
"""So many pairs of sequences 00-10 are the paper's experiment (it says 40,748)."""

_KITTI_COLUMNS = {
    "t_err_stereo": "t_err, stereo scale",
    "t_err_unit": "t_err, unit length",
    "t_err_length": "t_err, true length",
    "r_err": "r_err",
}
_NO_HOMOGRAPHY = 15_833_861_380.8
"""The paper's symmetric transfer error of a pair without an answer."""

_SAME_IMAGES = "The rows of the paper are over 40,748 pairs of sequences 00-10."


@dataclass(frozen=True)
class Line:
    """A row of a comparison: who, whether it is the paper's, and the cells."""

    method: str
    paper: bool
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """A table of the paper with our rows underneath."""

    title: str
    note: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]


def comparison(benchmark: Benchmark) -> Comparison | None:
    """The paper's table for a benchmark; None where the rows lack its measures."""
    if is_pose(benchmark):
        return _table_ii(benchmark)
    return _table_iii(benchmark)


def _table_ii(benchmark: Benchmark) -> Comparison | None:
    columns = {k: v for k, v in _KITTI_COLUMNS.items() if measured(benchmark.results, k)}
    if not columns:
        return None
    paper = {
        "SIFT": (0.680, 0.149, "1,854"),
        "objects": (0.744, 0.232, "7,146"),
        "proposed": (0.641, 0.086, "785"),
    }
    lines = []
    for method, (t_err, r_err, failures) in paper.items():
        cells = {"t_err_stereo": f"{t_err:.3f}", "r_err": f"{r_err:.3f}"}
        found = tuple(cells.get(name, DASH) for name in columns)
        lines.append(Line(f"paper: {method}", True, ("40,748", *found, failures)))
    for method, results in by_method(benchmark).items():
        failures = f"{sum(not result.localized for result in results):,}"
        means = tuple(_mean(_filled(results, name), 3) for name in columns)
        lines.append(Line(method, False, (f"{len(results):,}", *means, failures)))
    sizes = [len(results) for results in by_method(benchmark).values()]
    complete = all(size in KITTI_PAIRS for size in sizes)
    note = _SAME_IMAGES if complete else f"Not comparable: other pairs of images. {_SAME_IMAGES}"
    return Comparison(
        "The paper's Table II",
        f"{note} Its t_err has the length of the translation from stereo. Without an answer both "
        "errors are 1.",
        ("pairs", *columns.values(), "failures"),
        tuple(lines),
    )


def _table_iii(benchmark: Benchmark) -> Comparison | None:
    if not any(measured(benchmark.results, name) for name in ("ste", "ste_published")):
        return None
    lines = [
        Line("paper: SIFT", True, ("31", DASH, "10.654")),
        Line("paper: best (res3d, 64)", True, ("31", DASH, "9.339")),
    ]
    for method, results in by_method(benchmark).items():
        planar = [result for result in results if result.model == "homography"]
        means = (_mean_log(planar, name) for name in ("ste", "ste_published"))
        lines.append(Line(method, False, (f"{len(planar):,}", *means)))
    return Comparison(
        "The paper's Table III",
        "Not comparable: other images. Mean natural logarithm of the symmetric transfer error; the "
        "paper's published code leaves out the homogeneous division, which the last column does "
        "too.",
        ("pairs", "ln STE", "ln STE as published"),
        tuple(lines),
    )


def _filled(results: Sequence[Result], name: str) -> list[float]:
    """The values of an error, 1 where there is no answer."""
    return [
        result.measures.get(name, 1.0)
        for result in results
        if name in result.measures or not result.localized
    ]


def _mean_log(results: Sequence[Result], name: str) -> str:
    """Mean natural logarithm of a transfer error, the paper's largest where there is no answer."""
    values = [
        result.measures.get(name, _NO_HOMOGRAPHY)
        for result in results
        if name in result.measures or not result.localized
    ]
    return _mean([math.log(value) for value in values if value > 0], 3)


def _mean(values: Sequence[float], digits: int) -> str:
    return f"{statistics.fmean(values):.{digits}f}" if values else DASH
