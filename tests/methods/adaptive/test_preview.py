"""Preview: small frames that tell what hypotheses are worth zooming in on."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT
from nearfar.geometry.homography import transform
from nearfar.imaging.mask import MaskedImage
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.preview import Preview, similarity_of, worth_zooming

SIZE = 480, 480
TRUTH = np.array([[0.9 * 0.5, -0.436 * 0.5, 210.0], [0.436 * 0.5, 0.9 * 0.5, 60.0], [0, 0, 1.0]])
"""Half the size, turned by 26 degrees."""


def hypothesis(matrix: Matrix3) -> Hypothesis:
    return Hypothesis(matrix, 0.0, "landmarks")


@pytest.fixture(scope="module")
def preview(photograph: Callable[[str], RGBPixels]) -> Preview:
    far = cv2.resize(photograph("coffee"), (600, 400), interpolation=cv2.INTER_AREA)
    near = cv2.warpPerspective(
        far, np.linalg.inv(TRUTH), SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    return Preview(MaskedImage(np.asarray(far)), MaskedImage(np.asarray(near)), DEFAULT.zoom)


@pytest.mark.parametrize("foreshortened", [1.0, 1.5])
def test_matches_are_many_at_the_right_place_alone(preview: Preview, foreshortened: float) -> None:
    shorter = np.diag([1.0, 1 / foreshortened, 1.0])
    there = preview.matches(hypothesis(TRUTH @ shorter))
    elsewhere = preview.matches(hypothesis(np.array([[0.5, 0, 20], [0, 0.5, 150], [0, 0, 1.0]])))
    assert there is not None
    assert elsewhere is not None
    apart = np.linalg.norm(there.far - transform(TRUTH, there.near), axis=1)
    right = (apart < 1.5).sum()
    assert right >= 12
    assert right > 0.6 * len(there.far) / foreshortened
    assert right > len(elsewhere.far)


def test_a_small_full_frame_has_no_preview(preview: Preview) -> None:
    assert preview.matches(hypothesis(np.diag([0.15, 0.15, 1.0]))) is None


def test_a_smooth_near_image_has_no_preview(photograph: Callable[[str], RGBPixels]) -> None:
    far = MaskedImage(photograph("coffee"))
    smooth = np.asarray(cv2.GaussianBlur(photograph("coffee"), (0, 0), 12))
    preview = Preview(far, MaskedImage(smooth), DEFAULT.zoom)
    assert preview.matches(hypothesis(np.diag([0.9, 0.9, 1.0]))) is None


def test_a_place_outside_has_no_matches(preview: Preview) -> None:
    beyond = np.array([[0.5, 0, 5000], [0, 0.5, 150], [0, 0, 1.0]])
    found = preview.matches(hypothesis(beyond))
    assert found is not None
    assert len(found.far) == 0


def test_similarity_of_a_transform() -> None:
    scale, angle = similarity_of(TRUTH, SIZE)
    assert scale == pytest.approx(0.5, rel=0.01)
    assert angle == pytest.approx(np.arctan2(0.436, 0.9))
    assert similarity_of(TRUTH @ np.diag([1.0, 0.7, 1.0]), SIZE)[0] is None
    assert similarity_of(np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1.0]]), SIZE)[0] is None
    assert similarity_of(np.diag([-1.0, 1.0, 1.0]), SIZE)[0] is None


def test_clear_hypotheses_come_at_once_and_then_the_best_of_the_others() -> None:
    found = {0: 2.0, 1: None, 2: 0.5, 3: 7.0, 4: -40.0, 5: 2.9, 6: -1.0}
    batch = [Hypothesis(np.eye(3), float(key), "votes") for key in found]
    asked: list[float] = []

    def significance(each: Hypothesis) -> float | None:
        asked.append(each.support)
        return found[int(each.support)]

    previewed = ((each, significance(each)) for each in batch)
    order = worth_zooming(previewed, DEFAULT.zoom)
    assert next(order).support == 1
    assert asked == [0, 1]
    assert next(order).support == 4
    assert [each.support for each in order] == [6, 2]
