"""Selective Search (Uijlings et al., IJCV 2013), as OpenCV implements it."""

from typing import Any

import cv2
import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.errors import SettingsError
from nearfar.imaging.tiles import reduced_size
from nearfar.proposals import PROPOSERS, canonical, keep_object_like, scaled_boxes
from nearfar.settings import Settings

PAPER_K, OPENCV_K = 500, 150
"""Default scale parameter k of the strategy "single", and of the other two."""


OPENCV_SEGMENT = 100
"""OpenCV's smallest segment of the first segmentation, in pixels."""


@PROPOSERS.register("selective-search")
class SelectiveSearch:
    """Selective Search with the paper's filters; by default one strategy, k = 500, sigma = 0.9.

    Raises:
        SettingsError: the settings ask for what OpenCV's implementation does not have.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        if settings.proposal_size == "region":
            raise SettingsError(
                "OpenCV's Selective Search tells no sizes of regions: choose the proposer "
                "selectivesearch for the size of the region"
            )
        if settings.proposal_mode != "single" and settings.proposal_min_segment != OPENCV_SEGMENT:
            raise SettingsError(
                f"the strategy {settings.proposal_mode!r} has a fixed smallest segment: leave out "
                f"proposal_min_segment, or choose the strategy single"
            )
        self._settings = settings

    def propose(self, pixels: RGBPixels) -> Boxes:
        """See `Proposer.propose`.

        OpenCV orders its boxes by C `rand()`. The set of boxes is the same on every call, but the
        order is not, so the boxes are sorted.
        """
        settings = self._settings
        height, width = pixels.shape[:2]
        size = reduced_size(width, height, settings.proposal_max_size)
        if min(size) < 2:
            return np.empty((0, 4), np.int32)
        searched = pixels
        if size != (width, height):
            searched = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        boxes = scaled_boxes(self._search(searched), size, (width, height))
        return canonical(
            keep_object_like(boxes, settings.proposal_min_area, settings.proposal_max_aspect)
        )

    def _search(self, pixels: RGBPixels) -> Boxes:
        settings = self._settings
        single = settings.proposal_mode == "single"
        k = settings.proposal_k or (PAPER_K if single else OPENCV_K)
        search = cv2.ximgproc.segmentation.createSelectiveSearchSegmentation()
        search.setBaseImage(np.ascontiguousarray(pixels[..., ::-1]))
        if single:
            _use_single_strategy(search, pixels, k, settings)
        elif settings.proposal_mode == "fast":
            search.switchToSelectiveSearchFast(k, k, settings.proposal_sigma)
        else:
            search.switchToSelectiveSearchQuality(k, k, settings.proposal_sigma)
        return np.asarray(search.process(), np.int32).reshape(-1, 4)


def _use_single_strategy(search: Any, pixels: RGBPixels, k: float, settings: Settings) -> None:
    """Set what OpenCV's `switchToSingleStrategy` sets, with any smallest segment.

    One segmentation of the HSV image, and one strategy of four similarities with equal weights.
    """
    parts = cv2.ximgproc.segmentation
    search.clearImages()
    search.clearGraphSegmentations()
    search.clearStrategies()
    search.addImage(cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV))
    sigma, segment = settings.proposal_sigma, settings.proposal_min_segment
    search.addGraphSegmentation(parts.createGraphSegmentation(sigma, k, segment))
    search.addStrategy(
        parts.createSelectiveSearchSegmentationStrategyMultiple(
            parts.createSelectiveSearchSegmentationStrategyColor(),
            parts.createSelectiveSearchSegmentationStrategyFill(),
            parts.createSelectiveSearchSegmentationStrategyTexture(),
            parts.createSelectiveSearchSegmentationStrategySize(),
        )
    )
