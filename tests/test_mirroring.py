"""Near images that are mirrored are found where that is allowed, and hinted at where it is not."""

import numpy as np
import pytest

from nearfar import Localization, Localizer
from nearfar.geometry.homography import transform
from tests.conftest import KnownPair


def test_a_mirrored_image_is_hinted_at_and_found_where_allowed(known_pair: KnownPair) -> None:
    flipped = np.ascontiguousarray(known_pair.near[:, ::-1])
    failed = Localizer(max_effort="points").localize(known_pair.far, flipped)
    assert not failed.localized
    assert "--allow-mirrored" in str(failed.reason)
    found = Localizer(max_effort="points", allow_mirrored=True).localize(known_pair.far, flipped)
    assert found.localized
    assert found.mirrored
    model = np.asarray(found.far_from_near)
    assert np.linalg.det(model) < 0
    width = flipped.shape[1]
    assert known_pair.error(model @ [[-1, 0, width - 1], [0, 1, 0], [0, 0, 1]]) < 1
    inliers = found.points.inliers
    reprojected = transform(model, found.points.near[inliers])
    assert np.median(np.linalg.norm(reprojected - found.points.far[inliers], axis=1)) < 2
    assert found.footprint is not None
    top_left = transform(model, np.array([[-0.5, -0.5]]))
    np.testing.assert_allclose(found.footprint[:1], top_left, atol=1e-6)
    again = Localization.from_dict(found.to_dict())
    assert again.mirrored
    assert not Localization.from_dict({**failed.to_dict()}).mirrored


def test_no_hint_where_the_mirrored_image_does_not_match_either(known_pair: KnownPair) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3), np.uint8)
    failed = Localizer(max_effort="points").localize(known_pair.far, noise)
    assert "mirrored" not in str(failed.reason)


@pytest.mark.parametrize("options", [{"mirror_hints": False}, {"method": "points"}])
def test_hints_are_for_the_adaptive_method(known_pair: KnownPair, options: dict[str, str]) -> None:
    flipped = np.ascontiguousarray(known_pair.near[:, ::-1])
    failed = Localizer(**{"max_effort": "points", **options}).localize(known_pair.far, flipped)  # type: ignore[arg-type]
    assert not failed.localized
    assert "mirrored" not in str(failed.reason)


def test_an_image_that_is_not_mirrored_is_not_called_so(known_pair: KnownPair) -> None:
    found = Localizer(max_effort="points", allow_mirrored=True).localize(
        known_pair.far, known_pair.near
    )
    assert found.localized
    assert not found.mirrored
