"""Selective Search as the package `selectivesearch` of PyPI implements it."""

import warnings
from typing import Any

import numpy as np

from nearfar.arrays import Boxes, RGBPixels
from nearfar.errors import SettingsError
from nearfar.imaging.tiles import reduced_size
from nearfar.proposals import PROPOSERS, canonical, keep_object_like, scaled_boxes
from nearfar.runtime import require
from nearfar.settings import Settings

PAPER_K = 500
"""Default scale parameter k."""
SMALLEST_SIDE = 4
"""An image with a shorter side, in pixels, has no proposals: scikit-image's segmentation fails."""


@PROPOSERS.register("selectivesearch")
class SelectiveSearchPackage:
    """Selective Search of the package `selectivesearch`, whose names the authors' settings have.

    It is in Python alone, and takes 11 s for an image of KITTI. It merges segments by colour,
    texture (local binary patterns), size and fill, and knows the size of each region.

    Raises:
        MissingExtraError: the package is not installed.
        SettingsError: another strategy than "single" is asked for.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        require("paper", "selectivesearch", "skimage")
        if settings.proposal_mode != "single":
            raise SettingsError(f"the proposer {name} has one strategy: leave out proposal_mode")
        self._settings = settings

    def propose(self, pixels: RGBPixels) -> Boxes:
        """See `Proposer.propose`."""
        settings = self._settings
        height, width = pixels.shape[:2]
        size = reduced_size(width, height, settings.proposal_max_size)
        if min(size) < SMALLEST_SIDE:
            return np.empty((0, 4), np.int32)
        regions = _regions(_reduced(pixels, size), settings)
        boxes = np.array([each["rect"] for each in regions], np.int32).reshape(-1, 4)
        boxes[:, 2:] += 1  # The package counts the steps between pixels.
        boxes = scaled_boxes(boxes, size, (width, height))
        least = settings.proposal_min_area
        if settings.proposal_size == "region":
            area = width * height / (size[0] * size[1])
            regions_large = np.array([each["size"] * area >= least for each in regions], np.bool_)
            boxes, least = boxes[regions_large], 0
        return canonical(keep_object_like(boxes, least, settings.proposal_max_aspect))


def _reduced(pixels: RGBPixels, size: tuple[int, int]) -> RGBPixels:
    """Return an image at a size that is not larger."""
    if size == pixels.shape[1::-1]:
        return pixels
    import cv2

    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)


def _regions(pixels: RGBPixels, settings: Settings) -> list[dict[str, Any]]:
    """Return the package's regions: `rect` (x, y, and steps across and down) and `size`."""
    import selectivesearch

    with warnings.catch_warnings():  # It computes texture of numbers that are not whole.
        warnings.simplefilter("ignore")
        _, regions = selectivesearch.selective_search(
            pixels,
            scale=settings.proposal_k or PAPER_K,
            sigma=settings.proposal_sigma,
            min_size=settings.proposal_min_segment,
        )
    return list(regions)
