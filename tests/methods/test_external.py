"""Matchers of the user: what they may return, and every way in which they can be wrong."""

import json
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearfar import localize
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.errors import ExternalMethodError, SettingsError
from nearfar.geometry.homography import transform
from nearfar.localizer import Localizer
from nearfar.settings import Settings
from tests.conftest import KnownPair

Install = Callable[[Callable[..., Any]], str]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Makes a function importable and returns its method name."""

    def put(function: Callable[..., Any]) -> str:
        module = types.ModuleType("users_matchers")
        module.match = function  # type: ignore[attr-defined]
        monkeypatch.setitem(__import__("sys").modules, "users_matchers", module)
        return "python:users_matchers.match"

    return put


def test_exact_matches_give_the_exact_homography(install: Install, known_pair: KnownPair) -> None:
    near_xy = np.random.default_rng(0).uniform(0, 500, (60, 2))
    far_xy = transform(known_pair.far_from_near, near_xy)
    name = install(lambda far, near: (far_xy.tolist(), near_xy))  # noqa: ARG005
    for estimator in ("ransac", "magsac"):
        found = localize(known_pair.far, known_pair.near, method=name, estimator=estimator)
        assert known_pair.error(np.asarray(found.far_from_near)) < 1e-3


def test_no_matches_are_a_failure_with_a_reason(install: Install, known_pair: KnownPair) -> None:
    found = localize(known_pair.far, known_pair.near, method=install(lambda far, near: ([], [])))  # noqa: ARG005
    assert found.status == "failed"
    assert found.reason


def test_the_function_cannot_change_the_images(install: Install, known_pair: KnownPair) -> None:
    seen = []

    def vandal(far: Any, near: Any) -> Any:
        seen.append((far.copy(), near.copy()))
        far[:], near[:] = 0, 0
        return [], []

    localizer = Localizer(method=install(vandal))
    for _ in range(2):
        localizer.localize(known_pair.far, known_pair.near)
    for far, near in seen:
        np.testing.assert_array_equal(far, known_pair.far)
        np.testing.assert_array_equal(near, known_pair.near)


@pytest.mark.parametrize(
    "result",
    [
        None,
        7,
        np.zeros((5, 2)),
        (np.zeros((5, 2)),),
        (np.zeros((5, 2)), np.zeros((4, 2))),
        (np.zeros((5, 3)), np.zeros((5, 3))),
        (np.zeros(4), np.zeros(4)),
        ([["a", "b"]], [["c", "d"]]),
        ([[1, 2], [3]], [[1, 2], [3]]),
    ],
    ids=str,
)
def test_wrong_results_are_refused(install: Install, known_pair: KnownPair, result: Any) -> None:
    with pytest.raises(SettingsError, match=r"two arrays .* \(N, 2\)"):
        localize(known_pair.far, known_pair.near, method=install(lambda far, near: result))  # noqa: ARG005


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("python:", "module.function"),
        ("python:function", "module.function"),
        ("python:math.", "module.function"),
        ("python:no_such_module.match", "cannot be imported"),
        ("python:math.no_such_function", "has no function"),
        ("python:math.pi", "has no function"),
        ("python:..match", "cannot be imported"),
    ],
)
def test_what_does_not_exist_is_refused(name: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        Localizer(method=name)
    assert "\n" not in str(caught.value)


def test_a_benchmark_records_an_exception_and_goes_on(
    install: Install, known_files: tuple[Path, Path], tmp_path: Path
) -> None:
    def broken(far: Any, near: Any) -> Any:  # noqa: ARG001
        raise RuntimeError("no memory left")

    name = install(broken)
    far, near = known_files
    with pytest.raises(ExternalMethodError, match="RuntimeError: no memory left"):
        localize(far, near, method=name)
    points = [[10, 10], [200, 20], [30, 300], [250, 260]]
    for pair in ("one", "two"):
        folder = tmp_path / pair
        folder.mkdir()
        content = {"far": str(far), "near": str(near), "model": "homography"}
        content |= {"far_points": points, "near_points": points}  # type: ignore[dict-item]
        (folder / "pair.json").write_text(json.dumps(content), encoding="utf-8")
    rows = run(find_pairs(tmp_path), [Settings(method=name)], tmp_path / "rows.jsonl")
    assert [row.status for row in rows] == ["error", "error"]
    assert "no memory left" in (rows[0].reason or "")


def test_rows_that_are_not_finite_are_left_out(install: Install, known_pair: KnownPair) -> None:
    near_xy = np.random.default_rng(0).uniform(0, 500, (60, 2))
    far_xy = transform(known_pair.far_from_near, near_xy)
    bad = np.array([[np.nan, 3], [np.inf, 5], [7, 9]])
    far_more, near_more = np.vstack([bad, far_xy]), np.vstack([bad[::-1], near_xy])
    name = install(lambda far, near: (far_more, near_more))  # noqa: ARG005
    found = localize(known_pair.far, known_pair.near, method=name)
    assert len(found.points) == 60
    assert found.localized
