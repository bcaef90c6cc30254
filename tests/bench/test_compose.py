"""Made far images: the composed truth holds to a fraction of a pixel, and clutter is clutter."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image as PillowImage

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.bench.datasets.composites import (
    SCENE_SIZE,
    Backgrounds,
    View,
    compose,
    random_generator,
    random_view,
    reduction,
    tilt_homography,
)
from nearfar.errors import BenchmarkError
from nearfar.geometry.errors import transfer_errors
from nearfar.geometry.homography import outline, transform
from nearfar.localizer import Localizer
from nearfar.settings import Settings

Photograph = Callable[[str], RGBPixels]


def flat_scene(view: View, grey: int = 128) -> RGBPixels:
    return np.full((view.height, view.width, 3), grey, np.uint8)


def view_of(photo: RGBPixels, factor: float, name: str = "a", *, tilted: bool = False) -> View:
    height, width = photo.shape[:2]
    rng = random_generator(0, name)
    return random_view(width, height, factor, tilted=tilted, rng=rng)


def waves(width: int, height: int) -> RGBPixels:
    """A smooth photograph whose value at any subpixel place is known."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.repeat(np.rint(wave_at(x, y))[..., np.newaxis], 3, axis=2).astype(np.uint8)


def wave_at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(128 + 55 * np.sin(x / 23) + 55 * np.cos(y / 31))


def shift_between(made: RGBPixels, view: View, photo: RGBPixels) -> np.ndarray:
    """(2,) by how many pixels the image content lies off the composed truth (least squares)."""
    x, y = np.meshgrid(np.arange(view.width), np.arange(view.height))
    place = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    source = transform(np.linalg.inv(view.scene_from_photo), place)
    size = np.array(photo.shape[1::-1])
    inside = ((source > 12) & (source < size - 13)).all(axis=1)
    inside = cv2.erode(inside.reshape(x.shape).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    expected = wave_at(*source.T).reshape(x.shape)
    gradient = np.stack(np.gradient(expected)[::-1], -1)[inside]
    difference = made[..., 0].astype(float)[inside] - expected[inside]
    return np.asarray(np.linalg.lstsq(-gradient, difference, rcond=None)[0])


@pytest.mark.parametrize("factor", [1.0, 2.0, 3.5, 6.0])
@pytest.mark.parametrize("tilted", [False, True])
def test_content_lies_where_the_truth_says(factor: float, tilted: bool) -> None:
    photo = waves(640, 400)
    view = view_of(photo, factor, tilted=tilted)
    made = compose(photo, view, flat_scene(view))
    np.testing.assert_allclose(shift_between(made, view, photo), 0, atol=0.02)


def test_factor_one_leaves_every_pixel_as_it_is(photograph: Photograph) -> None:
    photo = photograph("astronaut")
    view = view_of(photo, 1)
    left, top = np.rint(view.scene_from_photo[:2, 2]).astype(int)
    made = compose(photo, view, flat_scene(view, 7))
    np.testing.assert_array_equal(made[top : top + 512, left : left + 512], photo)
    outside = np.ones(made.shape[:2], bool)
    outside[top : top + 512, left : left + 512] = False
    assert (made[outside] == 7).all()


def test_a_whole_reduction_is_the_mean_of_each_block(photograph: Photograph) -> None:
    photo = photograph("astronaut")
    view = view_of(photo, 4)
    left, top = np.rint(view.scene_from_photo[:2, 2] - reduction(4)[:2, 2]).astype(int)
    made = compose(photo, view, flat_scene(view))[top : top + 128, left : left + 128]
    means = photo.reshape(128, 4, 128, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(made, means, atol=1.1)


@pytest.mark.parametrize("tilted", [False, True])
def test_nothing_is_aliased_and_edges_do_not_ring(tilted: bool) -> None:
    stripes = np.zeros((600, 600, 3), np.uint8)
    stripes[:, ::2] = 255
    stripes[::2] = 255 - stripes[::2]
    view = view_of(stripes, 6, tilted=tilted)
    made = compose(stripes, view, flat_scene(view))
    assert np.abs(made.astype(int) - 128).max() <= 12


def test_tilt_is_a_foreshortening_about_the_centre() -> None:
    homography = tilt_homography(801, 601, 60, axis=90)
    centre = np.array([[400.0, 300.0]])
    np.testing.assert_allclose(transform(homography, centre), centre)
    step = 1e-4
    right = transform(homography, centre + np.array([step, 0])) - centre
    down = transform(homography, centre + np.array([0, step])) - centre
    np.testing.assert_allclose(np.linalg.norm(right) / step, np.cos(np.radians(60)), rtol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(down) / step, 1, rtol=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    width=st.integers(40, 1800),
    height=st.integers(40, 1500),
    factor=st.floats(1, 24),
    tilted=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_the_scene_holds_the_whole_photograph(
    width: int, height: int, factor: float, tilted: bool, seed: int
) -> None:
    rng = random_generator(seed, "any")
    view = random_view(width, height, factor, tilted=tilted, rng=rng)
    corners = transform(view.scene_from_photo, outline(width, height))
    assert (corners > -0.5 - 1e-5).all()
    assert (corners < np.array([view.width, view.height]) - 0.5 + 1e-5).all()
    assert view.width >= SCENE_SIZE[0]
    assert view.height >= SCENE_SIZE[1]
    assert (45 <= view.tilt <= 70) if tilted else view.tilt == 0


def test_random_numbers_depend_on_seed_and_name_alone() -> None:
    first = random_generator(3, "a", "view").random()
    random_generator(3, "b", "view").random()
    assert random_generator(3, "a", "view").random() == first
    others = [random_generator(4, "a", "view"), random_generator(3, "av", "iew")]
    assert first not in [other.random() for other in others]


@pytest.fixture(scope="module")
def background_folder(photograph: Photograph, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("backgrounds")
    for name in ("chelsea", "coffee", "rocket"):
        PillowImage.fromarray(photograph(name)).save(folder / f"{name}.png")
    return folder


def test_sift_finds_the_made_image(photograph: Photograph, background_folder: Path) -> None:
    photo = photograph("astronaut")
    turn: Matrix3 = np.array([[0.9, -0.2, 60], [0.15, 0.85, 20], [1e-4, -5e-5, 1]])
    near = cv2.warpPerspective(photo, turn, (512, 512), borderValue=(90, 90, 90))
    view = view_of(photo, 2)
    rng = random_generator(0, "scene")
    scene = Backgrounds(background_folder).collage(view.width, view.height, rng)
    far = compose(photo, view, scene)
    found = Localizer(Settings(method="sift", inlier_threshold=2.0)).localize(far, near)
    assert isinstance(found.far_from_near, np.ndarray)
    points = np.array([[150, 120], [400, 130], [380, 390], [160, 380], [256, 256.0]])
    truth = transform(view.scene_from_photo @ np.linalg.inv(turn), points)
    assert transfer_errors(found.far_from_near, truth, points).mean() < 1


def test_grey_photographs_make_grey_scenes(photograph: Photograph) -> None:
    grey = np.repeat(photograph("astronaut")[..., :1], 3, axis=2)
    view = view_of(grey, 3)
    scene = np.full((view.height, view.width, 3), (200, 30, 60), np.uint8)
    made = compose(grey, view, scene)
    assert (made[..., :1] == made).all()


def test_collages_are_full_and_repeat(background_folder: Path) -> None:
    backgrounds = Backgrounds(background_folder)
    first, again, other = (
        backgrounds.collage(700, 500, random_generator(seed, "scene")) for seed in (1, 1, 2)
    )
    assert first.shape == (500, 700, 3)
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_backgrounds_never_show_a_base_pair(photograph: Photograph, tmp_path: Path) -> None:
    pair = tmp_path / "pair"
    pair.mkdir()
    PillowImage.fromarray(photograph("astronaut")).save(pair / "far.png")
    PillowImage.fromarray(photograph("rocket")).save(pair / "other.png")
    small = cv2.resize(photograph("astronaut"), (300, 300), interpolation=cv2.INTER_AREA)
    PillowImage.fromarray(small).save(tmp_path / "copy.jpg", quality=60)
    for name in ("chelsea", "coffee"):
        PillowImage.fromarray(photograph(name)).save(tmp_path / f"{name}.png")
    images = [pair / "far.png"]
    used = Backgrounds(tmp_path, pair_images=images, base_images=images).files
    assert [file.name for file in used] == ["chelsea.png", "coffee.png"]


def test_a_folder_without_photographs_is_named(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match="background"):
        Backgrounds(tmp_path)
