"""Risk against coverage, by hand."""

from nearfar.bench.results import Result
from nearfar.bench.tables import risk_table


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
