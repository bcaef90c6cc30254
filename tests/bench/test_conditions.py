"""Conditions change the values of a photograph as their physics says, and no place."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.bench.datasets.conditions import CONDITIONS, WATERS, changed


@pytest.fixture
def coffee(photograph: Callable[[str], RGBPixels]) -> RGBPixels:
    return photograph("coffee")


@pytest.mark.parametrize("condition", CONDITIONS)
def test_edges_stay_where_they_are(condition: str, coffee: RGBPixels) -> None:
    seen = changed(coffee, condition, np.random.default_rng(0))
    assert seen.shape == coffee.shape
    assert not np.array_equal(seen, coffee)
    shift, response = cv2.phaseCorrelate(_edges(coffee), _edges(seen))
    assert np.hypot(*shift) < 0.1
    assert response > 0.1


@pytest.mark.parametrize("condition", CONDITIONS)
def test_the_generator_decides(condition: str, coffee: RGBPixels) -> None:
    first, same, other = (
        changed(coffee, condition, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, same)
    assert not np.array_equal(first, other)


def test_water_takes_red_first(coffee: RGBPixels) -> None:
    seen = changed(coffee, "underwater", np.random.default_rng(0)).astype(float)
    kept = seen.std(axis=(0, 1)) / coffee.std(axis=(0, 1))
    assert kept[0] < kept[1]
    assert kept[0] < kept[2]


def test_more_water_leaves_less_of_the_photograph(coffee: RGBPixels) -> None:
    seen = [changed(coffee, name, np.random.default_rng(0)) for name in WATERS]
    for channel in (0, 2):
        own = coffee[..., channel].ravel()
        left = [np.corrcoef(own, each[..., channel].ravel())[0, 1] for each in seen]
        assert left == sorted(left, reverse=True)
    assert np.corrcoef(coffee[..., 0].ravel(), seen[-1][..., 0].ravel())[0, 1] < 0.2


def test_haze_takes_contrast(coffee: RGBPixels) -> None:
    assert changed(coffee, "haze", np.random.default_rng(0)).std() < 0.6 * coffee.std()


def test_another_sensor_is_grey(coffee: RGBPixels) -> None:
    seen = changed(coffee, "sensor", np.random.default_rng(0)).astype(int)
    assert np.abs(np.diff(seen, axis=2)).mean() < 6


def _edges(pixels: RGBPixels) -> np.ndarray:
    grey = cv2.GaussianBlur(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 2)
    edges = np.hypot(cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1))
    return np.asarray(edges, np.float32)
