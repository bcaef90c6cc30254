"""The paper's tables, with the results of this package below."""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.pairs import MONTREAL
from nearfar.bench.results import Result
from nearfar.bench.summary import DASH, by_method, is_pose, measured, summarize
from nearfar.bench.tables import MEASURES, latex, log_ste, markdown

PAPER_TABLE_III = {"SIFT (paper)": 10.654, "res3d, 64 (paper's best)": 9.339}
"""Mean natural logarithm of the symmetric transfer error of 31 pairs (paper, Table III)."""
PAPER_PAIRS = 40_748
"""Pairs of frames in the paper's KITTI experiment."""
PAPER_TABLE_II = {
    "SIFT (paper)": (0.680, 0.149, 1854),
    "objects (paper)": (0.744, 0.232, 7146),
    "proposed (paper)": (0.641, 0.086, 785),
}
"""Mean t_err, mean r_err, failures (paper, Table II)."""
KITTI_PAIRS = range(40_000, 42_000)
"""Numbers of pairs that count as all of sequences 00-10, the paper's experiment."""
SEQUENCES = tuple(f"{number:02}" for number in range(11))
"""KITTI sequences of the paper's experiment."""
COLOUR_CAMERA = 2
"""KITTI's left colour camera, which the paper used."""
MONTREAL_PAIRS = 31
"""Number of the paper's image pairs."""
PAPER_SIZE = "1200x900"
"""Size to which the paper resizes them, as the tag `size` of cases has it."""


@dataclass(frozen=True)
class Line:
    """A row of a comparison: the method, whether it is the paper's, and the cells."""

    method: str
    paper: bool
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """A table of the paper with the results of this package below.

    Attributes:
        title: what it is.
        note: how to read it, and whether the paper's lines can be compared with the others.
        columns: titles of the columns after the first.
        lines: the rows; a cell in asterisks, as in "**8**", is bold.
        first: title of the first column.
    """

    title: str
    note: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]
    first: str = field(default="method", kw_only=True)

    def markdown(self) -> str:
        """Return the table in Markdown."""
        return markdown(*self._cells)

    def latex(self) -> str:
        """Return the table in LaTeX."""
        return latex(f"{self.title}. {self.note}", *self._cells)

    @property
    def _cells(self) -> tuple[list[str], list[list[str]]]:
        return [self.first, *self.columns], [[line.method, *line.cells] for line in self.lines]


def comparison(results: Sequence[Result]) -> Comparison | None:
    """Return the paper's table for some results; None where they lack its measures."""
    if not is_pose(results):
        return table_three(results) if measured(results, "ste") else None
    return table_two(results) if any(measured(results, name) for name in MEASURES) else None


def unlike_kitti(results: Sequence[Result]) -> str | None:
    """Return in what poses are not over the paper's pairs of frames; None where they are."""
    return _first(unlike_kitti_cases(own) for own in by_method(results).values())


def unlike_kitti_cases(cases: Sequence[Case] | Sequence[Result]) -> str | None:
    """Return in what pairs of frames are not the paper's; None where they are."""
    if len(cases) not in KITTI_PAIRS:
        return f"{len(cases):,} pairs of frames, not all of sequences 00 to 10"
    if {str(each.tags.get("sequence")) for each in cases} != set(SEQUENCES):
        return "other sequences"
    if {each.tags.get("camera") for each in cases} != {COLOUR_CAMERA}:
        return f"another camera than {COLOUR_CAMERA}"
    return None


def unlike_montreal(results: Sequence[Result]) -> str | None:
    """Return in what pairs are not the paper's image pairs; None where they are, as far as told."""
    return _first(unlike_montreal_cases(own) for own in by_method(results).values())


def unlike_montreal_cases(cases: Sequence[Case] | Sequence[Result]) -> str | None:
    """Return in what image pairs are not the paper's; None where they are, as far as told.

    The layout, the number and the size of the pairs are compared; their content is not known.
    """
    if any(each.tags.get("layout") != MONTREAL for each in cases):
        return "other images"
    if len(cases) != MONTREAL_PAIRS:
        return f"{len(cases)} pairs instead of {MONTREAL_PAIRS}"
    if any(each.tags.get("size") != PAPER_SIZE for each in cases):
        return f"images of another size than {PAPER_SIZE}"
    return None


def _first(differences: Iterable[str | None]) -> str | None:
    return next(filter(None, differences), None)


def verdict_on(difference: str | None) -> str:
    """Return whether results can be compared with the paper's, as a sentence."""
    return "Comparable." if difference is None else f"Not comparable: {difference}."


def table_two(
    results: Sequence[Result], title: str = "Poses, beside the paper's Table II"
) -> Comparison:
    """Compare poses with the paper's Table II: means over all pairs, 1 for each failure."""
    lines = []
    for method, (t_err, r_err, failures) in PAPER_TABLE_II.items():
        known = {"t_err_stereo": f"{t_err:.3f}", "r_err": f"{r_err:.3f}"}
        cells = (known.get(name, DASH) for name in MEASURES)
        lines.append(Line(method, True, (f"{PAPER_PAIRS:,}", *cells, f"{failures:,}", *3 * [DASH])))
    for method, own in by_method(results).items():
        total = summarize(own)
        found = (
            f"{len(own):,}",
            *(mean_text(statistics.fmean, measured(own, name), ".3f") for name in MEASURES),
            f"{total.unanswered.count:,}",
            f"{total.strict.value:.3f}",
            mean_text(statistics.median, measured(own, "rotation_degrees"), ".2f", "°"),
            mean_text(statistics.median, measured(own, "translation_degrees"), ".2f", "°"),
        )
        lines.append(Line(method, False, found))
    return Comparison(
        title,
        f"{verdict_on(unlike_kitti(results))} The paper's rows are over "
        f"{PAPER_PAIRS:,} pairs of sequences 00-10, with the length of the translation from "
        "stereo. Means over all pairs; without an answer an error is 1.",
        (
            "pairs",
            *MEASURES.values(),
            "failures",
            "within 5°",
            "median rotation error",
            "median translation error",
        ),
        tuple(lines),
    )


def table_three(results: Sequence[Result]) -> Comparison:
    """Compare the pairs with a homography with the paper's Table III."""
    lines = [
        Line(method, True, ("31", f"{value:.3f}", DASH, DASH, DASH))
        for method, value in PAPER_TABLE_III.items()
    ]
    planar = [result for result in results if result.model == "homography"]
    for method, own in by_method(planar).items():
        means = (
            mean_text(
                np.mean, [log_ste(each, name) for each in own if name in each.measures], ".3f"
            )
            for name in ("ste", "ste_published")
        )
        total = summarize(own)
        cells = (
            f"{len(own):,}",
            *means,
            f"{total.unanswered.count:,}",
            DASH if total.median_error is None else f"{total.median_error:.2f} px",
        )
        lines.append(Line(method, False, cells))
    return Comparison(
        "The paper's Table III",
        f"{verdict_on(unlike_montreal(planar))} Mean natural logarithm of the symmetric transfer "
        "error (STE) of ten points; the authors' released code leaves out the homogeneous "
        "division, and the paper does not say which it reports.",
        (
            "pairs",
            "mean ln STE",
            "mean ln STE, released code",
            "failures",
            "median error",
        ),
        tuple(lines),
    )


def mean_text(
    average: Callable[[Sequence[float]], float], values: Sequence[float], form: str, unit: str = ""
) -> str:
    """Return the average of some values with its unit; a dash where there are none."""
    return f"{average(values):{form}}{unit}" if values else DASH
