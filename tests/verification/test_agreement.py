"""Agreement: high where the homography is correct, low elsewhere, and unknown without cells."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nearfar import Localizer
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.geometry.homography import translation
from nearfar.imaging.mask import MaskedImage
from nearfar.settings import Settings
from nearfar.verification.agreement import agreement, near_cells
from nearfar.verification.placement import ByHomography
from tests.conftest import KnownPair


@pytest.fixture(scope="module")
def compare() -> Callable[[MaskedImage, MaskedImage, Matrix3], float | None]:
    descriptor = DESCRIPTORS.create("nearfar", Settings())
    assert isinstance(descriptor, DenseDescriptor)

    def share(far: MaskedImage, near: MaskedImage, matrix: Matrix3) -> float | None:
        limits = DEFAULT.agreement
        cells = near_cells(near, descriptor, limits)
        found = agreement(far, cells, ByHomography(matrix), NO_INLIERS, descriptor, limits)
        return None if found is None else found.share

    return share


NO_INLIERS = np.empty((0, 2))
Compare = Callable[[MaskedImage, MaskedImage, Matrix3], float | None]


def test_agreement_is_high_only_at_the_true_place(known_pair: KnownPair, compare: Compare) -> None:
    far, near, truth = (
        MaskedImage(known_pair.far),
        MaskedImage(known_pair.near),
        known_pair.far_from_near,
    )
    right = compare(far, near, truth)
    assert right is not None
    assert right > 0.9
    height, width = known_pair.near.shape[:2]
    for wrong in (translation(width / 3, 0), translation(0, -height / 3), np.diag([2.0, 2.0, 1])):
        found = compare(far, near, truth @ wrong)
        assert found is not None
        assert found < DEFAULT.agreement.least


def test_masked_cells_do_not_count(known_pair: KnownPair, compare: Compare) -> None:
    near = known_pair.near.copy()
    rng = np.random.default_rng(0)
    near[:, 200:] = rng.integers(0, 255, near[:, 200:].shape, np.uint8)
    mask = np.ones(near.shape[:2], np.bool_)
    mask[:, 190:] = False
    far, truth = MaskedImage(known_pair.far), known_pair.far_from_near
    whole, part = (compare(far, MaskedImage(near, each), truth) for each in (None, mask))
    assert whole is not None
    assert part is not None
    assert part > 0.9 > whole + 0.2


def test_nothing_is_said_where_the_images_share_nothing(
    known_pair: KnownPair, compare: Compare
) -> None:
    far, near = MaskedImage(known_pair.far), MaskedImage(known_pair.near)
    assert compare(far, near, translation(5000, 0)) is None
    nothing = np.zeros(known_pair.far.shape[:2], np.bool_)
    assert compare(MaskedImage(known_pair.far, nothing), near, known_pair.far_from_near) is None


def test_a_shared_logo_is_not_a_place(
    photograph: Callable[[str], RGBPixels], known_pair: KnownPair
) -> None:
    far, near = photograph("chelsea").copy(), photograph("coffee").copy()
    logo = known_pair.near[100:180, 150:290]
    far[110:190, 150:290], near[170:250, 240:380] = logo, logo
    found = Localizer(max_effort="points").localize(far, near)
    assert not found.localized
    assert "looks like the far image" in str(found.reason)


def test_a_real_shared_logo_is_not_a_place(extra_data: Path) -> None:
    folder = extra_data / "cases/localized-without-outline"
    found = Localizer(max_effort="points").localize(folder / "far.png", folder / "near.png")
    assert not found.localized


def test_every_model_is_accepted_where_that_is_asked(
    photograph: Callable[[str], RGBPixels], known_pair: KnownPair
) -> None:
    far, near = photograph("chelsea").copy(), photograph("coffee").copy()
    logo = known_pair.near[100:180, 150:290]
    far[110:190, 150:290], near[170:250, 240:380] = logo, logo
    every = Localizer(max_effort="points", max_false_alarms=float("inf"), min_confidence=0)
    assert every.localize(far, near).localized
