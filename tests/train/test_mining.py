from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")

from nearfar.arrays import RGBPixels
from nearfar.errors import TrainingError
from nearfar.geometry.homography import transform
from nearfar.train.mining import mined_pairs, read_pairs, save_pairs
from nearfar.train.photographs import Photograph
from nearfar.train.real_views import follow
from nearfar.train.training_set import TrainingSet
from nearfar.train.views import Region

FAR_FROM_NEAR = np.array([[0.8, 0.15, 20], [-0.12, 0.85, 60], [0, 0, 1]])


@pytest.fixture(scope="module")
def of_two_places(photograph: Callable[[str], RGBPixels]) -> list[Photograph]:
    """Two photographs of one place, one of another, and one in another folder."""
    coffee = photograph("coffee")
    seen = cv2.warpAffine(coffee, FAR_FROM_NEAR[:2], (coffee.shape[1], coffee.shape[0]))
    files = {"one/a": seen, "one/b": coffee, "one/c": photograph("astronaut"), "two/d": coffee}
    return [Photograph(Path(name), (np.asarray(pixels),)) for name, pixels in files.items()]


def test_photographs_of_one_place_are_found(of_two_places: list[Photograph]) -> None:
    (pair,) = mined_pairs(of_two_places, 2)
    assert (pair.far, pair.near) == (0, 1)
    away = np.hypot(*(transform(FAR_FROM_NEAR, pair.near_points) - pair.far_points).T)
    assert np.median(away) < 1
    region = Region(1, 300, 180, 90, 70)
    followed = follow(region, pair, of_two_places[0])
    assert followed is not None
    truth = transform(FAR_FROM_NEAR, region.corners())
    np.testing.assert_allclose(transform(followed.far_from_near, region.corners()), truth, atol=2)
    assert follow(Region(1, 590, 20, 18, 18), pair, of_two_places[0]) is None


def test_kept_pairs_are_those_of_the_photographs(
    of_two_places: list[Photograph], tmp_path: Path
) -> None:
    pairs = mined_pairs(of_two_places[:2], 1)
    file = tmp_path / "pairs.npz"
    save_pairs(file, TrainingSet(of_two_places[:2], pairs), 1)
    (again,) = read_pairs(file, of_two_places[:2], 1)
    np.testing.assert_array_equal(again.far_points, pairs[0].far_points)
    with pytest.raises(TrainingError, match="other photographs"):
        read_pairs(file, of_two_places[:3], 1)
    with pytest.raises(TrainingError, match="--neighbours 1"):
        read_pairs(file, of_two_places[:2], 2)
    for damaged in (b"damaged", file.read_bytes()[:200]):
        file.write_bytes(damaged)
        with pytest.raises(TrainingError, match="cannot be read"):
            read_pairs(file, of_two_places[:2], 1)
