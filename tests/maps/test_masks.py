"""Masks of map images and queries: what is masked gives no landmark, keypoint or place."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nearfar import ImageError, open_map
from nearfar.arrays import RGBPixels
from nearfar.imaging.mask_folder import MaskFolder
from nearfar.maps.landmarks import Landmarks, unmasked
from nearfar.maps.map import Map
from nearfar.maps.store import MapStore
from nearfar.maps.tables import unpacked_keypoints
from tests.conftest import KnownPair
from tests.maps.conftest import small, write

Pictures = Callable[[str], RGBPixels]


def left_masked(pixels: RGBPixels) -> np.ndarray:
    """(height, width) black on the left."""
    mask = np.full(pixels.shape[:2], 255, np.uint8)
    mask[:, : pixels.shape[1] * 3 // 4] = 0
    return mask


@pytest.fixture
def scene(pictures: Pictures, tmp_path: Path) -> RGBPixels:
    """A photograph in photos/a/b.png, and its mask in masks/a/b.png.png."""
    pixels = small(pictures("astronaut"))
    write(tmp_path / "photos/a/b.png", pixels)
    write(tmp_path / "masks/a/b.png.png", left_masked(pixels))
    return pixels


def add(tmp_path: Path, **options: object) -> tuple[Map, tuple[int, int, int, int]]:
    map_ = open_map(tmp_path / "map", create=True, max_effort="points")
    added = map_.add(tmp_path / "photos", **options)  # type: ignore[arg-type]
    return map_, (added.added, added.replaced, added.unchanged, len(added.failed))


def test_what_is_masked_gives_no_landmark_and_no_keypoint(scene: RGBPixels, tmp_path: Path) -> None:
    map_, counts = add(tmp_path, masks=tmp_path / "masks")
    assert counts == (1, 0, 0, 0)
    store, (image,) = MapStore(map_.folder), map_.images
    assert image.landmarks > 0
    limit = scene.shape[1] * 3 // 4
    for block in store.blocks():
        assert (block.place[:, 0] >= limit).all()
    for tile in store.tiles(image.id):
        stored = store.keypoints(image.id, tile)
        assert stored is not None
        xy = unpacked_keypoints(stored).xy
        assert len(xy)
        assert (xy[:, 0] >= limit).all()


def test_a_place_is_found_until_it_is_masked(
    scene: RGBPixels, small_close_up: KnownPair, tmp_path: Path
) -> None:
    map_, _ = add(tmp_path)
    (whole,) = map_.images
    assert map_.locate(small_close_up.near).located
    assert not map_.locate(
        small_close_up.near, mask=np.pad(np.ones((8, 8)), ((0, 412), (0, 472)))
    ).located
    map_, counts = add(tmp_path, masks=tmp_path / "masks")
    assert counts == (0, 1, 0, 0)
    (masked,) = map_.images
    assert masked.id != whole.id
    assert masked.landmarks < whole.landmarks
    for answer in map_.locate(small_close_up.near).answers:
        assert (answer.points.far[:, 0] >= 0.75 * scene.shape[1]).all()
    assert add(tmp_path, masks=tmp_path / "masks")[1] == (0, 0, 1, 0)
    assert add(tmp_path)[1] == (0, 0, 1, 0)  # Without masks it keeps what it has.
    assert map_.images == (masked,)
    write(tmp_path / "masks/a/b.png.png", np.full(scene.shape[:2], 255, np.uint8))
    map_, counts = add(tmp_path, masks=tmp_path / "masks")
    assert counts == (0, 1, 0, 0)
    assert map_.locate(small_close_up.near).located


@pytest.mark.parametrize("damage", ["size", "content"])
def test_a_bad_mask_leaves_out_its_image_alone(
    damage: str, scene: RGBPixels, tmp_path: Path
) -> None:
    write(tmp_path / "photos/c.png", scene)
    bad = tmp_path / "masks/c.png.png"
    write(bad, np.ones((9, 9), np.uint8))
    if damage == "content":
        bad.write_bytes(b"no mask")
    map_ = open_map(tmp_path / "map", create=True)
    added = map_.add(tmp_path / "photos", masks=tmp_path / "masks")
    assert added.added == 1
    ((name, reason),) = added.failed
    assert name == "photos/c.png"
    assert "as large as the image" in reason if damage == "size" else "cannot be read" in reason


def test_transparent_pixels_of_a_map_image_are_masked(scene: RGBPixels, tmp_path: Path) -> None:
    write(tmp_path / "photos/a/b.png", np.dstack([scene, left_masked(scene)]))
    map_, _ = add(tmp_path)
    for block in MapStore(map_.folder).blocks():
        assert len(block.place)
        assert (block.place[:, 0] >= scene.shape[1] * 3 // 4).all()


def test_a_folder_of_masks_must_exist(scene: RGBPixels, tmp_path: Path) -> None:  # noqa: ARG001
    with pytest.raises(ImageError, match="no folder"):
        add(tmp_path, masks=tmp_path / "missing")


def test_masks_are_named_as_colmap_names_them(tmp_path: Path) -> None:
    mask = write(tmp_path / "a/b.jpg.png", np.ones((2, 2), np.uint8))
    folder = MaskFolder.opened(tmp_path)
    assert folder.mask_of("a/b.jpg") == mask
    assert folder.mask_of("b.jpg") is None
    assert folder.mask_of("../a/b.jpg") is None


def test_windows_that_show_little_of_a_mask_stay() -> None:
    mask = np.ones((100, 100), np.bool_)
    mask[:, :50] = False
    centre = np.array([[20.0, 50], [52, 50], [70, 50], [90, 50]])
    none = np.zeros(4)
    landmarks = Landmarks(centre, np.full(4, 32.0), none, np.zeros((4, 256), np.float16))
    assert unmasked(landmarks, mask).centre[:, 0].tolist() == [70, 90]
    assert unmasked(landmarks, None) is landmarks
