"""Selective Search (Uijlings et al., IJCV 2013), as OpenCV implements it."""

import cv2
import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.imaging.tiles import reduced_size
from nearfar.proposals import PROPOSERS, canonical, keep_object_like, scaled_boxes
from nearfar.settings import Settings

PAPER_K, OPENCV_K = 500, 150
"""Default scale parameter k of the strategy "single", and of the other two."""


@PROPOSERS.register("selective-search")
class SelectiveSearch:
    """Selective Search with the paper's filters; by default one strategy, k = 500, sigma = 0.9."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
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
            search.switchToSingleStrategy(k, settings.proposal_sigma)
        elif settings.proposal_mode == "fast":
            search.switchToSelectiveSearchFast(k, k, settings.proposal_sigma)
        else:
            search.switchToSelectiveSearchQuality(k, k, settings.proposal_sigma)
        return np.asarray(search.process(), np.int32).reshape(-1, 4)
