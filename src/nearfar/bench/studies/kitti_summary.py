"""Summary and plots of the KITTI experiment."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearfar.bench.tables import distinct, markdown, method_name
from nearfar.render.plotting import figure_axes, save_figure
from nearfar.storage.rows import Row

PAPER_PAIRS = 40_748
"""Pairs of frames in the paper's experiment."""
PAPER_TABLE_II = {
    "SIFT (paper)": (0.680, 0.149, 1854),
    "objects (paper)": (0.744, 0.232, 7146),
    "proposed (paper)": (0.641, 0.086, 785),
}
"""Mean t_err, mean r_err, failures (paper, Table II)."""

MEASURES = {
    "t_err_unit": "t_err, unit length",
    "t_err_stereo": "t_err, stereo length",
    "t_err_length": "t_err, true length",
    "r_err": "r_err",
}


@dataclass(frozen=True)
class LogFit:
    """Least-squares fit a + b ln x."""

    a: float
    b: float


def table_two(rows: Sequence[Row]) -> str:
    """Markdown: per method means over all pairs, failures counted as 1, and the answers' angles."""
    header = [
        "method",
        "pairs",
        *MEASURES.values(),
        "failures",
        "within 5°",
        "median rotation error",
        "median translation error",
    ]
    lines = []
    for method in distinct(method_name(row) for row in rows):
        own = [row for row in rows if method_name(row) == method]
        lines.append(
            [
                method,
                str(len(own)),
                *(_mean_cell(own, measure) for measure in MEASURES),
                str(sum(row["status"] != "localized" for row in own)),
                f"{np.mean([row['strict'] for row in own]):.3f}",
                _median_cell(own, "rotation_degrees"),
                _median_cell(own, "translation_degrees"),
            ]
        )
    for method, (t_err, r_err, failures) in PAPER_TABLE_II.items():
        cells = ["", f"{t_err:.3f}", "", f"{r_err:.3f}", str(failures), "", "", ""]
        lines.append([method, str(PAPER_PAIRS), *cells])
    return markdown(header, lines)


def by_step(rows: Sequence[Row], value: Callable[[Row], float | None]) -> dict[int, float]:
    """Mean of a value over the pairs of each j, without those that have none."""
    means = {}
    for j in sorted({int(row["tags"]["j"]) for row in rows}):
        values = [v for row in rows if row["tags"]["j"] == j and (v := value(row)) is not None]
        if values:
            means[j] = float(np.mean(values))
    return means


def step_table(rows: Sequence[Row]) -> str:
    """Markdown: per j the mean distance and per method the share within 5 degrees."""
    methods = distinct(method_name(row) for row in rows)
    distances = by_step(rows, lambda row: float(row["tags"]["distance"]))
    lines = []
    for j, distance in distances.items():
        chosen = [row for row in rows if row["tags"]["j"] == j]
        count = len({row["case"] for row in chosen})
        cells = []
        for method in methods:
            own = [row["strict"] for row in chosen if method_name(row) == method]
            cells.append(f"{np.mean(own):.2f}" if own else "")
        lines.append([str(j), f"{distance:.1f} m", str(count), *cells])
    return markdown(["j", "mean distance", "pairs", *methods], lines)


def log_fit(x: Sequence[float], y: Sequence[float]) -> LogFit:
    """Fit y = a + b ln x through the group means, as in the paper's plots."""
    b, a = np.polyfit(np.log(x), y, 1)
    return LogFit(float(a), float(b))


def _mean_cell(rows: Sequence[Row], measure: str) -> str:
    values = [row[measure] for row in rows if row.get(measure) is not None]
    return f"{np.mean(values):.3f}" if values else ""


def _median_cell(rows: Sequence[Row], measure: str) -> str:
    values = [row[measure] for row in rows if row.get(measure) is not None]
    return f"{np.median(values):.2f}°" if values else ""


def fit_table(rows: Sequence[Row]) -> str:
    """Markdown: per method the logarithmic fits of its group means."""
    lines = []
    for method in distinct(method_name(row) for row in rows):
        own = [row for row in rows if method_name(row) == method]
        cells = []
        for measure in MEASURES:
            means = by_step(own, lambda row, name=measure: row.get(name))  # type: ignore[misc]
            distances = by_step(own, lambda row: float(row["tags"]["distance"]))
            if len(means) < 2:
                cells.append("")
                continue
            fit = log_fit([distances[j] for j in means], list(means.values()))
            cells.append(f"{fit.a:.3f} {fit.b:+.3f} ln x")
        lines.append([method, *cells])
    return markdown(["method", *MEASURES.values()], lines)


def _failed(row: Row) -> float:
    return float(row["status"] != "localized")


Plot = tuple[str, Callable[[Row], float | None], bool]
"""Axis label, value of a row, whether a logarithmic fit is drawn."""


def plots(rows: Sequence[Row]) -> dict[str, Plot]:
    """By file name. t_err is with the length from stereo only where all rows have it."""
    if all(row.get("t_err_stereo") is not None for row in rows):
        translation: Plot = ("t_err, length from stereo", lambda row: row["t_err_stereo"], True)
    else:
        translation = ("t_err, unit length", lambda row: row["t_err_unit"], True)
    return {
        "translation_error": translation,
        "rotation_error": ("r_err", lambda row: row["r_err"], True),
        "failure_rate": ("share of failures", _failed, False),
    }


def plot_kitti(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Each error against the distance: group means by j, and a fit a + b ln x.

    Returns:
        The files written, PNG.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    return [_plot(rows, plot, folder / f"kitti_{name}.png") for name, plot in plots(rows).items()]


def _plot(rows: Sequence[Row], plot: Plot, file: Path) -> Path:
    label, value, fitted = plot
    figure, axes = figure_axes()
    for index, method in enumerate(distinct(method_name(row) for row in rows)):
        own = [row for row in rows if method_name(row) == method]
        distances = by_step(own, lambda row: float(row["tags"]["distance"]))
        means = by_step(own, value)
        x, y = [distances[j] for j in means], list(means.values())
        axes.plot(x, y, "o", color=f"C{index}", label=method, markersize=5)
        if fitted and len(x) > 1:
            fit = log_fit(x, y)
            dense = np.linspace(min(x), max(x), 100)
            axes.plot(dense, fit.a + fit.b * np.log(dense), color=f"C{index}", linewidth=1.5)
    axes.set_xlabel("distance between the cameras in metres (mean of each j)")
    axes.set_ylabel(label)
    axes.set_ylim(0, 1)
    axes.legend()
    return save_figure(figure, file)
