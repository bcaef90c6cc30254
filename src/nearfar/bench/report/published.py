"""The paper's own results beside ours (Table II, Table III)."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from nearfar.bench.report.load import Benchmark, Result
from nearfar.bench.report.summary import DASH, by_method, is_pose, measured, summarize
from nearfar.bench.studies.kitti_summary import MEASURES, PAPER_PAIRS, PAPER_TABLE_II
from nearfar.bench.studies.pairs import PAPER_TABLE_III

KITTI_PAIRS = range(40_000, 42_000)
"""So many pairs of sequences 00-10 are the paper's experiment."""


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
    if not any(measured(benchmark.results, name) for name in MEASURES):
        return None
    lines = []
    for method, (t_err, r_err, failures) in PAPER_TABLE_II.items():
        cells = {"t_err_stereo": f"{t_err:.3f}", "r_err": f"{r_err:.3f}"}
        found = (cells.get(name, DASH) for name in MEASURES)
        lines.append(Line(method, True, (f"{PAPER_PAIRS:,}", *found, f"{failures:,}")))
    for method, results in by_method(benchmark).items():
        unanswered = f"{summarize(results).unanswered.count:,}"
        means = (_mean(measured(results, name)) for name in MEASURES)
        lines.append(Line(method, False, (f"{len(results):,}", *means, unanswered)))
    complete = all(len(results) in KITTI_PAIRS for results in by_method(benchmark).values())
    return Comparison(
        "The paper's Table II",
        f"{'' if complete else 'Not comparable: other pairs. '}The paper's rows are over "
        f"{PAPER_PAIRS:,} pairs of sequences 00-10, with the length of the translation from "
        "stereo. Means over all pairs; without an answer an error is 1.",
        ("pairs", *MEASURES.values(), "failures"),
        tuple(lines),
    )


def _table_iii(benchmark: Benchmark) -> Comparison | None:
    if not measured(benchmark.results, "ste"):
        return None
    lines = [
        Line(method, True, ("31", DASH, f"{value:.3f}", DASH))
        for method, value in PAPER_TABLE_III.items()
    ]
    for method, results in by_method(benchmark).items():
        planar = [result for result in results if result.model == "homography"]
        means = (_mean_log(planar, name) for name in ("ste", "ste_published"))
        unanswered = f"{summarize(planar).unanswered.count:,}"
        lines.append(Line(method, False, (f"{len(planar):,}", *means, unanswered)))
    return Comparison(
        "The paper's Table III",
        "Not comparable: other images. Mean natural logarithm of the symmetric transfer error "
        "(STE) of ten points; the paper's published code leaves out the homogeneous division.",
        ("pairs", "mean ln STE", "mean ln STE, published code", "failures"),
        tuple(lines),
    )


def _mean_log(results: Sequence[Result], name: str) -> str:
    return _mean([math.log(value) for value in measured(results, name) if value > 0])


def _mean(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):.3f}" if values else DASH
