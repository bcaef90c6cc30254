"""One image laid over the other: they agree under the true homography and under no other."""

import numpy as np
import pytest

from nearfar import Image, read_image
from nearfar.arrays import Matrix3
from nearfar.imaging.image import ImagePair
from nearfar.render.alignment import Overlay, far_on_near, near_on_far
from tests.conftest import KnownPair
from tests.render.build import Shift, localized


def overlays(images: ImagePair, homography: Matrix3) -> tuple[Overlay, Overlay]:
    found = localized(images.far, images.near, homography)
    above, below = near_on_far(found, images, 500, 500), far_on_near(found, images, 500, 500)
    assert above is not None
    assert below is not None
    return above, below


def agreement(overlay: Overlay) -> float:
    """Correlation of both images where they cover each other."""
    both = overlay.cover > 0.99
    below, above = (side[both].mean(axis=1) for side in (overlay.below, overlay.above))
    return float(np.corrcoef(below, above)[0, 1])


def moved(far_from_near: Matrix3, pixels: float) -> Matrix3:
    """The same homography, so many far pixels to the right."""
    return Shift(1, pixels, 0).matrix @ far_from_near


@pytest.mark.parametrize(("far_size", "near_size"), [(0, 0), (400, 0), (0, 300), (400, 300)])
def test_layers_agree_under_the_truth_alone(
    known_pair: KnownPair, far_size: int, near_size: int
) -> None:
    far = read_image(known_pair.far, max_size=far_size)
    images = ImagePair(far, read_image(known_pair.near, max_size=near_size))
    right = overlays(images, known_pair.far_from_near)
    for pixels in (-4.0, 4.0):
        wrong = overlays(images, moved(known_pair.far_from_near, pixels))
        for true, false in zip(right, wrong, strict=True):
            assert agreement(true) > 0.97
            assert agreement(false) < agreement(true) - 0.03


def test_the_truth_aligns_better_than_a_third_of_a_pixel(known_pair: KnownPair) -> None:
    images = ImagePair(read_image(known_pair.far), read_image(known_pair.near))
    shifts = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
    for layer in (0, 1):
        agreed = [
            agreement(overlays(images, moved(known_pair.far_from_near, shift))[layer])
            for shift in shifts
        ]
        assert shifts[int(np.argmax(agreed))] == 0


def test_blend_and_checkerboard_are_made_of_both(known_pair: KnownPair) -> None:
    images = ImagePair(read_image(known_pair.far), read_image(known_pair.near))
    for overlay in overlays(images, known_pair.far_from_near):
        both, neither = overlay.cover == 1, overlay.cover == 0
        mean = (overlay.below.astype(float) + overlay.above) / 2
        assert np.abs(overlay.blend() - mean)[both].max() <= 0.5
        board = overlay.checkerboard()
        from_below = (board == overlay.below).all(axis=2)
        from_above = (board == overlay.above).all(axis=2)
        assert (from_below | from_above)[both].all()
        assert 0.3 < from_above[both].mean() < 0.7
        assert from_below[neither].all()


def textured(width: int, height: int) -> Image:
    return read_image(np.random.default_rng(0).integers(0, 255, (height, width), dtype=np.uint8))


def test_the_frame_shows_the_surroundings_of_the_footprint_enlarged() -> None:
    images = ImagePair(textured(600, 400), textured(200, 100))
    found = localized(images.far, images.near, Shift(0.25, 300, 200).matrix)
    overlay = near_on_far(found, images, 800, 800)
    assert overlay is not None
    assert overlay.enlarged == pytest.approx(800 / 70, rel=0.01)
    assert overlay.below.shape[:2] == (400, 800)
    assert overlay.note == "enlarged 11.4 times"
    at_corner = overlay.frame_from_far @ [299.5 + 0.125, 199.5 + 0.125, 1]
    assert overlay.cover[int(at_corner[1]) + 20, int(at_corner[0]) + 20] == 1
    assert overlay.cover[int(at_corner[1]) - 20, int(at_corner[0]) - 20] == 0


def test_a_fine_pattern_is_averaged_when_reduced() -> None:
    images = ImagePair(textured(100, 100), textured(800, 800))
    found = localized(images.far, images.near, Shift(0.05, 20, 20).matrix)
    overlay = near_on_far(found, images, 64, 64)
    assert overlay is not None
    inside = overlay.above[overlay.cover == 1]
    assert np.abs(inside.astype(float) - 127.5).max() < 40
