"""nearfar as a matcher of vismatch (formerly image-matching-models), which need not be installed.

`NearfarMatcher` is called like `BaseMatcher.forward` of vismatch 1.4: it takes two images and
returns a dictionary of NumPy arrays. It does not need torch.
"""

import os
from typing import Any, TypedDict

import numpy as np
from PIL import Image as PillowImage

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.errors import ImageError
from nearfar.imaging.decoding import pillow_pixels
from nearfar.imaging.image import ImageSource
from nearfar.localizer import Localizer


class MatcherResult(TypedDict):
    """The result of a vismatch matcher; coordinates are (N, 2), x and y in pixels.

    nearfar does not return unmatched keypoints, descriptors or confidences of single matches.
    Their fields have the values that vismatch uses for such matchers: (0, 2) arrays, and None.
    """

    num_inliers: int
    H: Matrix3 | None
    all_kpts0: Coordinates
    all_kpts1: Coordinates
    all_desc0: Coordinates
    all_desc1: Coordinates
    matched_kpts0: Coordinates
    matched_kpts1: Coordinates
    inlier_kpts0: Coordinates
    inlier_kpts1: Coordinates
    matched_confidences: None


class NearfarMatcher:
    """Matches two images with nearfar. Image 0 is the near one, so `H` is `far_from_near`.

    Args:
        **options: `Settings` by name, e.g. method="sift-tuned".

    Raises:
        SettingsError: an option is unknown or out of range.
        WeightsError: the descriptor needs weights that are missing or do not fit.
    """

    name = "nearfar"

    def __init__(self, **options: Any) -> None:
        self._localizer = Localizer(**options)

    def __call__(self, img0: Any, img1: Any) -> MatcherResult:
        """Match two images.

        Args:
            img0: near image: a path, a PIL image of 8 bits a channel or of 16 bits grey, or an
                array or tensor (3, height, width) of values from 0 to 1.
            img1: far image.

        Returns:
            The matches; `H` is None and there are no inliers if nearfar finds no homography.

        Raises:
            ImageError: an image cannot be read, its array has another shape or type, or a PIL
                image has values of more than 16 bits.
        """
        found = self._localizer.localize(_source(img1), _source(img0), model="homography")
        points, nothing = found.points, np.empty((0, 2))
        return MatcherResult(
            num_inliers=int(points.inliers.sum()),
            H=None if found.far_from_near is None else np.asarray(found.far_from_near),
            all_kpts0=nothing,
            all_kpts1=nothing,
            all_desc0=nothing,
            all_desc1=nothing,
            matched_kpts0=points.near,
            matched_kpts1=points.far,
            inlier_kpts0=points.near[points.inliers],
            inlier_kpts1=points.far[points.inliers],
            matched_confidences=None,
        )


def _source(image: Any) -> ImageSource:
    if isinstance(image, str | os.PathLike):
        return image
    if isinstance(image, PillowImage.Image):
        return pillow_pixels(image, "a matcher's image")
    on_cpu = image.detach().cpu() if hasattr(image, "detach") else image
    return _pixels(np.asarray(on_cpu))


def _pixels(values: np.ndarray) -> RGBPixels:
    unit = values.dtype.kind == "f" and values.size and values.min() >= 0 and values.max() <= 1
    if not (values.ndim == 3 and values.shape[0] == 3 and unit):
        raise ImageError(
            f"a matcher's image is an array (3, height, width) of values from 0 to 1, not "
            f"{values.shape} of {values.dtype}"
        )
    return np.ascontiguousarray(np.rint(values * 255).astype(np.uint8).transpose(1, 2, 0))
