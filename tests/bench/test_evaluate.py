"""Errors of a localization, against values worked out by hand."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import nearfar
from nearfar.bench.datasets.cases import Case
from nearfar.bench.evaluate import evaluate, failure_columns, true_diagonal
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.errors import PAPER_FAILURE_STE
from tests.conftest import KnownPair

SQUARE = np.array([[0, 0], [100, 0], [100, 100], [0, 100], [50, 50.0]])


def case(model: str) -> Case:
    return Case(
        name="made",
        group="made",
        far=Path("far.png"),
        near=Path("near.png"),
        model=model,  # type: ignore[arg-type]
        scale_change=2.0,
        far_points=SQUARE / 2,
        near_points=SQUARE,
        pose=RelativePose(np.eye(3), np.array([0, 0, 5.0])),
    )


@pytest.fixture(scope="module")
def found(known_pair: KnownPair) -> nearfar.Localization:
    """A real localization, whose model the tests replace."""
    return nearfar.localize(known_pair.far, known_pair.near, method="sift")


def test_homography_three_pixels_off(found: nearfar.Localization) -> None:
    shifted = np.array([[0.5, 0, 3], [0, 0.5, 0], [0, 0, 1.0]])
    errors = evaluate(case("homography"), dataclasses.replace(found, far_from_near=shifted))
    assert errors["error"] == pytest.approx(3)
    assert errors["median_error"] == pytest.approx(3)
    assert errors["strict"] is False
    # The near image of 512x512 has a footprint of 256x256 with a diagonal of 362: loose is 36.
    assert errors["loose"] is True
    # 3 px in the far and 6 px in the near image at 5 points, scaled to 10.
    assert errors["ste"] == pytest.approx(5 * 9 * 2)
    assert errors["ste_published"] == pytest.approx(5 * 9 * 2)
    assert true_diagonal(case("homography"), 512, 512) == pytest.approx(256 * np.sqrt(2))


def test_fundamental_matrix_four_rows_off(found: nearfar.Localization) -> None:
    # y_far = y_near / 2 + 4 for every pair of points.
    matrix = np.array([[0, 0, 0], [0, 0, -1], [0, 0.5, 4.0]])
    errors = evaluate(case("fundamental"), dataclasses.replace(found, far_from_near=matrix))
    # 4 px from the line in the far image and 8 px in the near one.
    assert errors["error"] == pytest.approx(6)
    assert (errors["strict"], errors["loose"]) == (False, False)


def test_a_true_point_on_the_horizon_counts_as_the_papers_failure(
    found: nearfar.Localization,
) -> None:
    right = case("homography").near_points[:, 0].max()
    horizon = np.array([[0.5, 0, 0], [0, 0.5, 0], [-1 / right, 0, 1.0]])
    errors = evaluate(case("homography"), dataclasses.replace(found, far_from_near=horizon))
    assert errors["ste"] == PAPER_FAILURE_STE


@pytest.mark.parametrize(("degrees", "success"), [(4.9, True), (5.1, False)])
def test_pose(found: nearfar.Localization, degrees: float, success: bool) -> None:
    angle = np.radians(degrees)
    direction = np.array([np.sin(angle), 0, np.cos(angle)])
    pose = RelativePose(np.eye(3), direction)
    errors = evaluate(case("pose"), dataclasses.replace(found, far_from_near=pose))
    assert errors["error"] == pytest.approx(degrees)
    assert errors["rotation_degrees"] == pytest.approx(0)
    assert errors["translation_degrees"] == pytest.approx(degrees)
    assert errors["strict"] is success
    assert errors["r_err"] == pytest.approx(0)
    assert errors["t_err_unit"] == pytest.approx(np.linalg.norm(direction - [0, 0, 5]) / 6)
    assert errors["t_err_length"] == pytest.approx(np.sin(angle / 2))
    assert errors["t_err_stereo"] is None


def test_failures() -> None:
    pose = failure_columns(case("pose"))
    assert (pose["r_err"], pose["t_err_unit"], pose["t_err_length"]) == (1, 1, 1)
    homography = failure_columns(case("homography"))
    assert homography["ste"] == homography["ste_published"] == PAPER_FAILURE_STE
    for model in ("pose", "homography", "fundamental"):
        errors = failure_columns(case(model))
        assert (errors["error"], errors["strict"], errors["loose"]) == (None, False, False)
