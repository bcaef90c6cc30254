"""`save_localization`: which pictures are written for which answer, and that they stay readable."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import (
    Image,
    ImageError,
    LandmarkMatches,
    Localization,
    PointMatches,
    RelativePose,
    read_image,
)
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.imaging.image import ImagePair
from nearfar.render import save_localization
from nearfar.render.alignment import footprint_page
from nearfar.render.draw import MARK
from nearfar.verification.expected_error import ExpectedError
from tests.conftest import KnownPair
from tests.render.build import Shift, localized

MATCHES = {"landmark_matches", "point_matches"}
WARPED = {"blend", "checkerboard", "far_in_near_blend", "far_in_near_checkerboard"}
NOTHING = PointMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.bool_))
NO_BOXES = LandmarkMatches(
    np.empty((0, 4), np.int32), np.empty((0, 4), np.int32), np.empty(0, np.float32)
)


def saved(
    localization: Localization, folder: Path, images: tuple[Image, Image]
) -> dict[str, RGBPixels]:
    """The pictures by name; each must be a legible size."""
    pictures = {}
    for path in save_localization(localization, folder, images=[each.pixels for each in images]):
        if path.suffix == ".png":
            with PillowImage.open(path) as opened:
                assert (opened.format, opened.mode) == ("PNG", "RGB")
                pictures[path.stem] = np.asarray(opened)
            height, width = pictures[path.stem].shape[:2]
            assert 100 <= height <= 1400, path
            assert 700 <= width <= 2000, path
    return pictures


@pytest.fixture(scope="session")
def pair(known_pair: KnownPair) -> tuple[Image, Image]:
    return read_image(known_pair.far), read_image(known_pair.near)


def test_a_homography_has_every_picture(
    pair: tuple[Image, Image], known_pair: KnownPair, tmp_path: Path
) -> None:
    found = localized(*pair, known_pair.far_from_near)
    pictures = saved(found, tmp_path, pair)
    assert set(pictures) == MATCHES | WARPED | {"footprint"}
    assert {path.stem for path in tmp_path.glob("*.png")} == set(pictures)


def test_no_picture_of_an_earlier_answer_is_left(
    pair: tuple[Image, Image], known_pair: KnownPair, tmp_path: Path
) -> None:
    (tmp_path / "notes.png").write_bytes(b"not ours")
    found = localized(*pair, known_pair.far_from_near)
    saved(found, tmp_path, pair)
    pictures = saved(replace(found, far_from_near=None, footprint=None), tmp_path, pair)
    assert {path.stem for path in tmp_path.glob("*.png")} == set(pictures) | {"notes"}


def test_a_method_without_landmarks_has_no_landmark_picture(
    pair: tuple[Image, Image], known_pair: KnownPair, tmp_path: Path
) -> None:
    found = localized(*pair, known_pair.far_from_near, descriptor=None, landmarks=NO_BOXES)
    assert "landmark_matches" not in saved(found, tmp_path, pair)


@pytest.mark.parametrize("points", [None, NOTHING])
def test_a_failure_shows_its_matches(
    pair: tuple[Image, Image], tmp_path: Path, points: PointMatches | None
) -> None:
    found = localized(*pair, np.eye(3))
    none = np.zeros(len(found.points), np.bool_)
    failed = replace(
        found,
        status="failed",
        reason="a homography needs 4 different point matches, found 0",
        far_from_near=None,
        footprint=None,
        scale_change=None,
        points=points or replace(found.points, inliers=none),
        landmarks=NO_BOXES if points is NOTHING else found.landmarks,
    )
    assert set(saved(failed, tmp_path, pair)) == MATCHES


def test_a_pose_and_a_fundamental_matrix_have_no_footprint(
    pair: tuple[Image, Image], tmp_path: Path
) -> None:
    pose = RelativePose(np.eye(3), np.array([0, 0, 1.0]))
    sideways = np.array([[0, 0, 0], [0, 0, -1], [0, 1.0, 0]])
    found = localized(*pair, np.eye(3), footprint=None)
    assert set(saved(replace(found, model="pose", far_from_near=pose), tmp_path, pair)) == MATCHES
    epipolar = replace(found, model="fundamental", far_from_near=sideways)
    assert set(saved(epipolar, tmp_path, pair)) == MATCHES | {"epipolar_lines"}


@pytest.mark.parametrize(
    ("name", "homography"),
    [
        ("horizon", np.array([[1, 0, 0], [0, 1, 0], [0.005, 0, -1.0]])),
        ("outside", Shift(0.2, 50_000, 0).matrix),
        ("point", Shift(1e-5, 300, 200).matrix),
        ("line", np.diag([0.2, 1e-9, 1.0])),
    ],
)
def test_wild_homographies_are_not_warped(
    pair: tuple[Image, Image], tmp_path: Path, name: str, homography: Matrix3
) -> None:
    pictures = saved(localized(*pair, homography), tmp_path, pair)
    assert set(pictures) - {"footprint"} == MATCHES
    assert ("footprint" in pictures) == (name != "horizon")


@pytest.mark.parametrize(
    "homography",
    [
        Shift(1e6, -1e8, -1e8).matrix,
        np.array([[1, 0, 0], [0, 1, 0], [-0.00194, 0, 1.0]]),
        np.array([[-0.2, 0, 500], [0, 0.2, 200], [0, 0, 1.0]]),
        Shift(0.02, 400, 300).matrix,
        Shift(0.5, 600, -100).matrix,
    ],
    ids=["huge", "near the horizon", "mirrored", "small", "partly outside"],
)
def test_unusual_homographies_are_warped_at_a_bounded_size(
    pair: tuple[Image, Image], tmp_path: Path, homography: Matrix3
) -> None:
    assert saved(localized(*pair, homography), tmp_path, pair).keys() >= WARPED


@pytest.mark.parametrize(
    ("far_shape", "near_shape"),
    [
        ((1, 1), (1, 1)),
        ((300, 400), (1, 1)),
        ((1, 1), (300, 400)),
        ((20, 3000), (2000, 30)),
        ((100, 300), (100, 300)),
    ],
    ids=str,
)
def test_images_of_any_shape(
    tmp_path: Path, far_shape: tuple[int, int], near_shape: tuple[int, int]
) -> None:
    far, near = (read_image(np.full(shape, 90, np.uint8)) for shape in (far_shape, near_shape))
    saved(
        localized(far, near, np.eye(3), points=NOTHING, landmarks=NO_BOXES),
        tmp_path / "found",
        (far, near),
    )
    failed = localized(far, near, np.eye(3), points=NOTHING, footprint=None, far_from_near=None)
    saved(
        replace(failed, status="failed", reason="nothing " * 60), tmp_path / "failed", (far, near)
    )


def test_a_far_image_longer_than_opencv_can_warp(tmp_path: Path) -> None:
    stripe = np.zeros((40, 40_000), np.uint8)
    stripe[:, ::100] = 255
    far, near = read_image(stripe), read_image(np.full((300, 400), 90, np.uint8))
    assert (
        saved(localized(far, near, Shift(0.1, 39_000, 5).matrix), tmp_path, (far, near)).keys()
        >= WARPED
    )


@pytest.mark.parametrize("max_size", [0, 200])
def test_the_outline_is_drawn_where_the_footprint_is(
    known_pair: KnownPair, tmp_path: Path, max_size: int
) -> None:
    far = read_image(known_pair.far, max_size=max_size)
    near = read_image(known_pair.near, max_size=max_size)
    found = localized(far, near, known_pair.far_from_near)
    originals = read_image(known_pair.far), read_image(known_pair.near)
    page = saved(found, tmp_path, originals)["footprint"]
    assert found.footprint is not None
    rows, columns = np.nonzero((page == MARK).all(axis=2))
    scale = 640 / 480  # the far image is 480 pixels high, its panel 640
    drawn = np.array([[columns.min(), rows.min()], [columns.max(), rows.max()]])
    corners = (found.footprint + 0.5) * scale - 0.5
    extent = np.stack([corners.min(axis=0), corners.max(axis=0)])
    offset = drawn - extent
    np.testing.assert_allclose(offset[0] - offset[1], 0, atol=5)
    np.testing.assert_allclose(offset.mean(axis=0), [28, 60], atol=1)


def test_the_caption_of_the_outline_tells_confidence_and_expected_error(
    pair: tuple[Image, Image], known_pair: KnownPair
) -> None:
    found = localized(*pair, known_pair.far_from_near)
    error = ExpectedError(2.5, (1.0, 2.0, 3.0, 44.0))
    told = [found, replace(found, confidence=0.97), replace(found, expected_error=error)]
    plain, *others = (np.asarray(footprint_page(each, ImagePair(*pair))) for each in told)
    for page in others:
        rows = np.nonzero((page != plain).any(axis=(1, 2)))[0]
        assert rows.min() > len(plain) - 60


def test_same_answer_same_bytes(
    pair: tuple[Image, Image], known_pair: KnownPair, tmp_path: Path
) -> None:
    found = localized(*pair, known_pair.far_from_near)
    images = [each.pixels for each in pair]
    first, second = (
        save_localization(found, tmp_path / "1", images=images),
        save_localization(found, tmp_path / "2", images=images),
    )
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_a_file_that_cannot_be_written_is_an_os_error(
    pair: tuple[Image, Image], tmp_path: Path
) -> None:
    (tmp_path / "point_matches.png").mkdir()
    with pytest.raises(OSError, match="point_matches"):
        saved(localized(*pair, np.eye(3)), tmp_path, pair)


def test_images_given_as_arrays_are_needed_again(pair: tuple[Image, Image], tmp_path: Path) -> None:
    found = localized(*pair, np.eye(3))
    with pytest.raises(ImageError, match="give images="):
        save_localization(found, tmp_path / "out")
    far, near = (each.pixels for each in pair)
    with pytest.raises(ImageError, match="localize again"):
        save_localization(found, tmp_path / "out", images=(far[:-1], near))
    assert not (tmp_path / "out").exists()
