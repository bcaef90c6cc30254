"""The study of altitudes: which pairs are taken straight down, and its tables."""

from pathlib import Path

import numpy as np
import pytest

from nearfar.bench.datasets.cases import Case
from nearfar.bench.results import Result
from nearfar.bench.studies.altitude import Altitude, stretch
from nearfar.errors import BenchmarkError
from nearfar.geometry.homography import transform
from nearfar.settings import Settings

CORNERS = np.array([[0.0, 0], [100, 0], [100, 80], [0, 80], [50, 30]])


def case(homography: np.ndarray) -> Case:
    far = transform(homography, CORNERS)
    return Case("a/b", "a", Path("far"), Path("near"), "homography", 4.0, far, CORNERS)


@pytest.mark.parametrize(("across", "expected"), [(0.25, 1.0), (0.2, 1.25), (0.125, 2.0)])
def test_stretch_of_known_homographies(across: float, expected: float) -> None:
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    assert stretch(case(turn @ np.diag([0.25, across, 1]))) == pytest.approx(expected, rel=1e-6)


def test_a_folder_without_such_pairs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError):
        Altitude("altitude", Settings()).cases(tmp_path)


def test_tables_have_the_ratio_of_heights() -> None:
    rows = [
        Result.from_dict(
            {
                "case": f"site/{number}",
                "group": "site",
                "method": "m",
                "status": "localized",
                "strict": ratio < 6,
                "loose": ratio < 6,
                "true_scale_change": ratio,
                "tags": {"base": str(number)},
            }
        )
        for number, ratio in enumerate((3.5, 5.0, 7.0))
    ]
    tables = Altitude("altitude", Settings()).tables(rows)
    assert "| 3-4 | 1 | 1 | 100 (100 to 100) / 100 |" in "\n".join(tables.values())
    assert "| site | 3 | 2 / 2 |" in tables["Successes by site, strict / loose"]
