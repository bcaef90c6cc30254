"""Tables and plots of the experiments, against values worked out by hand."""

import numpy as np
import pytest

from nearfar.bench.figures import kitti_plots
from nearfar.bench.published import table_three, table_two
from nearfar.bench.results import Result
from nearfar.bench.studies.kitti import fit_table, step_table
from nearfar.bench.summary import DASH, log_fit
from nearfar.bench.tables import risk_table
from nearfar.geometry.errors import PAPER_FAILURE_STE


def pose_row(j: int, t_err: float, r_err: float, status: str = "localized") -> Result:
    row = {
        "case": f"{j}-{t_err}",
        "method": "sift",
        "descriptor": None,
        "status": status,
        "strict": t_err < 0.5,
        "tags": {"j": j, "distance": 5.0 * j},
        "t_err_unit": t_err,
        "t_err_length": t_err / 2,
        "t_err_stereo": None,
        "r_err": r_err,
        "rotation_degrees": None if status == "failed" else 2.0,
        "translation_degrees": None if status == "failed" else 4.0,
        "model": "pose",
    }
    return Result.from_dict(row)


ROWS = [pose_row(1, 0.2, 0.1), pose_row(1, 0.4, 0.1), pose_row(2, 1.0, 1.0, "failed")]


def test_table_two() -> None:
    table = table_two(ROWS).markdown()
    row = next(line for line in table.splitlines() if line.startswith("| sift |"))
    cells = [cell.strip() for cell in row.split("|")[1:-1]]
    assert cells == ["sift", "3", "0.533", DASH, "0.267", "0.400", "1", "0.667", "2.00°", "4.00°"]
    assert f"| proposed (paper) | 40,748 | {DASH} | 0.641 |" in table


def test_step_table() -> None:
    assert "| 1 | 5.0 m | 2 | 1.00 |" in step_table(ROWS)
    assert "| 2 | 10.0 m | 1 | 0.00 |" in step_table(ROWS)


def test_log_fit_recovers_its_curve() -> None:
    x = np.array([5, 10, 20, 40.0])
    fit = log_fit(x.tolist(), (0.2 + 0.1 * np.log(x)).tolist())
    assert (fit.a, fit.b) == pytest.approx((0.2, 0.1))


def test_fits_pass_through_the_means_of_each_step() -> None:
    rows = [pose_row(1, 0.2, 0.1), pose_row(1, 0.4, 0.1), pose_row(2, 0.5, 0.1)]
    # Means 0.3 at 5 m and 0.5 at 10 m: b = 0.2 / ln 2, a = 0.3 - b ln 5.
    slope = 0.2 / np.log(2)
    assert f"{0.3 - slope * np.log(5):.3f} {slope:+.3f} ln x" in fit_table(rows)


def test_table_three() -> None:
    rows = [
        {
            "case": "a",
            "method": "sift",
            "descriptor": None,
            "model": "homography",
            "status": status,
            "ste": ste,
            "ste_published": 2 * ste,
            "error": error,
        }
        for status, ste, error in (
            ("localized", np.e**2, 0.5),
            ("localized", np.e**4, 1.5),
            ("failed", PAPER_FAILURE_STE, None),
        )
    ]
    table = table_three([Result.from_dict(row) for row in rows]).markdown()
    mean = (2 + 4 + np.log(PAPER_FAILURE_STE)) / 3
    line = next(line for line in table.splitlines() if line.startswith("| sift"))
    assert line == f"| sift | 3 | {mean:.3f} | {mean + np.log(2):.3f} | 1 | 1.00 px |"
    assert "| SIFT (paper) | 31 |" in table


def row(exponent: float | None, right: bool, status: str = "localized") -> Result:
    row = {
        "case": "a",
        "method": "sift",
        "descriptor": None,
        "status": status,
        "log10_nfa": exponent,
        "strict": right,
    }
    return Result.from_dict(row)


def test_risk_falls_as_more_is_refused() -> None:
    rows = [
        row(-200, True),
        row(-60, True),
        row(-15, False),
        row(-5, False),
        row(None, False),
        row(None, False, "failed"),
    ]
    cells = [line.split("|")[2].strip() for line in risk_table(rows).splitlines()[2:]]
    assert cells == [
        "0.60 at 0.83",
        "0.50 at 0.67",
        "0.33 at 0.50",
        "0.00 at 0.33",
        "0.00 at 0.33",
        "0.00 at 0.17",
    ]
    assert "no answer at 0.00" in risk_table(rows[3:])


def test_limits_above_that_of_the_runs_are_left_out() -> None:
    """What such a run refused is a failure in its rows, whatever limit the table asks about."""
    rows = [row(None, False, "failed")]
    limits = [line.split("|")[1].strip() for line in risk_table(rows, 1e-20).splitlines()[2:]]
    assert limits == ["1e-20", "1e-50", "1e-100"]


def test_lengths_from_stereo_and_unit_lengths_are_not_mixed() -> None:
    pose = {"case": "a", "method": "sift"}
    with_stereo = Result.from_dict(pose | {"t_err_stereo": 0.05, "t_err_unit": 0.67})
    without = Result.from_dict(pose | {"t_err_stereo": None, "t_err_unit": 0.8})
    plot = kitti_plots([with_stereo, with_stereo])["translation_error"]
    assert (plot.label, plot.value(with_stereo)) == ("t_err, length from stereo", 0.05)
    plot = kitti_plots([with_stereo, without])["translation_error"]
    assert (plot.label, plot.value(with_stereo), plot.value(without)) == (
        "t_err, unit length",
        0.67,
        0.8,
    )
