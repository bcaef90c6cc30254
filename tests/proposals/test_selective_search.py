"""Selective Search: the paper's filters, order, reduced size."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from nearfar.arrays import Boxes, RGBPixels
from nearfar.errors import SettingsError
from nearfar.proposals import PROPOSERS, canonical, keep_object_like
from nearfar.proposals.selective_search import SelectiveSearch
from nearfar.settings import Settings


def boxes_of(pixels: RGBPixels, **options: object) -> Boxes:
    return SelectiveSearch("selective-search", Settings().replace(**options)).propose(pixels)


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Largest intersection over union of box `a` with any of the boxes `b`."""
    low = np.maximum(a[:2], b[:, :2])
    high = np.minimum(a[:2] + a[2:], b[:, :2] + b[:, 2:])
    common = np.clip(high - low, 0, None).prod(axis=1)
    return float((common / (a[2:].prod() + b[:, 2:].prod(axis=1) - common)).max())


def test_filters_of_the_paper(photograph: Callable[[str], RGBPixels]) -> None:
    boxes = boxes_of(photograph("coffee"))
    assert len(boxes) > 50
    width, height = boxes[:, 2], boxes[:, 3]
    assert (width * height >= 200).all()
    assert (np.maximum(width, height) <= 3 * np.minimum(width, height)).all()


def test_canonical_order_is_the_same_on_every_call(photograph: Callable[[str], RGBPixels]) -> None:
    image = photograph("chelsea")
    first, second = boxes_of(image), boxes_of(image)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first, np.unique(first, axis=0))


@pytest.mark.parametrize("max_size", [0, 250])
def test_boxes_lie_inside_and_settings_matter(
    photograph: Callable[[str], RGBPixels], max_size: int
) -> None:
    image = photograph("chelsea")
    boxes = boxes_of(image, proposal_max_size=max_size)
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, :2] + boxes[:, 2:] <= [image.shape[1], image.shape[0]]).all()
    for change in ({"proposal_k": 50}, {"proposal_sigma": 0.5}, {"proposal_mode": "fast"}):
        other = boxes_of(image, proposal_max_size=max_size, **change)
        assert not np.array_equal(other, boxes)


def test_reduced_search_finds_the_same_objects() -> None:
    image = np.full((300, 400, 3), 40, np.uint8)
    image[50:150, 60:180] = (200, 40, 40)
    image[180:270, 250:350] = (30, 180, 220)
    boxes = boxes_of(image, proposal_max_size=200)
    for expected in ([60, 50, 120, 100], [250, 180, 100, 90]):
        assert overlap(np.array(expected), boxes) > 0.9


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (3, 3), (60, 80)])
def test_flat_and_tiny_images_have_no_objects(size: tuple[int, int]) -> None:
    boxes = boxes_of(np.full((*size, 3), 128, np.uint8))
    assert boxes.shape[1] == 4
    assert len(boxes) <= 1


def test_opencvs_smallest_segment_is_the_default_and_a_smaller_one_gives_more_boxes(
    photograph: Callable[[str], RGBPixels],
) -> None:
    image = np.ascontiguousarray(photograph("chelsea")[:200, :250])
    search = cv2.ximgproc.segmentation.createSelectiveSearchSegmentation()
    search.setBaseImage(np.ascontiguousarray(image[..., ::-1]))
    search.switchToSingleStrategy(500, 0.9)
    usual = canonical(keep_object_like(np.asarray(search.process(), np.int32), 200, 3))
    np.testing.assert_array_equal(boxes_of(image), usual)
    assert len(boxes_of(image, proposal_min_segment=10)) > len(usual)


def test_the_package_tells_boxes_of_large_regions_from_large_boxes(
    photograph: Callable[[str], RGBPixels],
) -> None:
    pytest.importorskip("selectivesearch")
    image = np.ascontiguousarray(photograph("chelsea")[:100, :120])
    chosen = Settings(
        proposal_k=50, proposal_min_segment=10, proposal_min_area=400, proposal_max_aspect=10
    )
    box, region = (
        PROPOSERS.create("selectivesearch", chosen.replace(proposal_size=size)).propose(image)
        for size in ("box", "region")
    )
    assert 0 < len(region) < len(box)
    assert {tuple(each) for each in region} <= {tuple(each) for each in box}


@pytest.mark.parametrize(
    "options",
    [{"proposal_size": "region"}, {"proposal_mode": "fast", "proposal_min_segment": 10}],
)
def test_what_opencv_lacks_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=r"choose|leave out"):
        boxes_of(np.zeros((9, 9, 3), np.uint8), **options)
