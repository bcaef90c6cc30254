"""Detection: image -> keypoints, with OpenCV's detectors and RootSIFT."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError
from nearfar.features import DETECTORS
from nearfar.features.keypoints import Keypoints
from nearfar.settings import Settings

PAPER_CONTRAST = 0.04
"""SIFT's contrast threshold in the paper."""
LOW_CONTRAST = 0.02
"""Contrast threshold of the detector `rootsift-0.02`, which finds more keypoints. The best of a
grid on the development data, whichever set is left out (or as good as the best)."""
MOST_ORB_KEYPOINTS = 8000
"""Most keypoints of ORB in an image; SIFT finds about as many. OpenCV's 500 are for video."""
MOST_OF_A_VIEW = 500
"""Most keypoints in each of the 43 simulated views of ASIFT, which bounds the time."""
SMALLEST_SIDE = 8
"""An image with a shorter side, in pixels, has no keypoints: OpenCV's detectors fail or crash."""


def sift(contrast_threshold: float = PAPER_CONTRAST, most: int = 0) -> Any:
    """Return OpenCV's SIFT with the paper's other parameters, at pixel-exact positions.

    OpenCV's default shifts every keypoint by a quarter of a pixel when it doubles the image; its
    `enable_precise_upscale` does not.

    Args:
        contrast_threshold: a lower one finds more keypoints.
        most: keep this many keypoints, those of the highest contrast; 0 keeps all.
    """
    return cv2.SIFT_create(
        nfeatures=most,
        nOctaveLayers=3,
        contrastThreshold=contrast_threshold,
        edgeThreshold=10,
        sigma=1.6,
        enable_precise_upscale=True,
    )


def detect(pixels: RGBPixels, detector: Any) -> Keypoints:
    """Return the keypoints that an OpenCV detector finds and describes.

    Args:
        pixels: the image.
        detector: a `cv2.Feature2D`.

    Raises:
        ImageError: the image is too large for OpenCV: SIFT takes sides of up to 32,766 pixels.
    """
    keypoints, descriptors = (), None
    if min(pixels.shape[:2]) >= SMALLEST_SIDE:
        grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
        try:
            keypoints, descriptors = detector.detectAndCompute(grey, None)
        except cv2.error as error:
            height, width = grey.shape
            raise ImageError(
                f"OpenCV cannot find points in an image of {width}x{height} pixels: reduce it "
                f"(--max-size)"
            ) from error
    if not keypoints:
        binary = detector.descriptorType() == cv2.CV_8U
        length = detector.descriptorSize() * (8 if binary else 1)
        return Keypoints.of(np.empty((0, 2)), np.empty((0, length)))
    if descriptors.dtype == np.uint8:
        descriptors = np.unpackbits(descriptors, axis=1)
    rows = [(*each.pt, each.size, each.angle, each.response) for each in keypoints]
    table = np.array(rows, np.float64)
    return Keypoints.of(
        table[:, :2],
        descriptors,
        scale=table[:, 2],
        angle=np.radians(table[:, 3]),
        score=table[:, 4],
    )


def detect_sift(pixels: RGBPixels, contrast_threshold: float = PAPER_CONTRAST) -> Keypoints:
    """Return SIFT keypoints with the paper's parameters; descriptors are whole numbers 0 to 255."""
    return detect(pixels, sift(contrast_threshold))


def detect_rootsift(
    pixels: RGBPixels, contrast_threshold: float = PAPER_CONTRAST, most: int = 0
) -> Keypoints:
    """Return SIFT keypoints described by RootSIFT; see `sift` for the arguments."""
    return root_sift(detect(pixels, sift(contrast_threshold, most)))


def root_sift(keypoints: Keypoints) -> Keypoints:
    """Return keypoints with RootSIFT descriptors (Arandjelovic and Zisserman, CVPR 2012).

    A RootSIFT descriptor is the root of a SIFT descriptor that is scaled to the sum 1, so its
    length is 1. The Euclidean distance of two is the Hellinger distance of the SIFT descriptors.
    """
    total = keypoints.descriptors.sum(axis=1, keepdims=True)
    return replace(keypoints, descriptors=np.sqrt(keypoints.descriptors / np.maximum(total, 1)))


@DETECTORS.register("sift", "rootsift", "rootsift-0.02")
class Sift:
    """SIFT (Lowe, 2004) with the paper's parameters.

    As `rootsift` its descriptors are RootSIFT; as `rootsift-0.02` it also finds keypoints of lower
    contrast.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._rooted = name != "sift"
        self._contrast = LOW_CONTRAST if name == "rootsift-0.02" else PAPER_CONTRAST

    def detect(self, pixels: RGBPixels) -> Keypoints:
        """See `Detector.detect`."""
        found = detect_sift(pixels, self._contrast)
        return root_sift(found) if self._rooted else found


@DETECTORS.register("akaze", "orb")
class Binary:
    """AKAZE (Alcantarilla et al., 2013) or ORB (Rublee et al., 2011): binary descriptors."""

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self._name = name

    def detect(self, pixels: RGBPixels) -> Keypoints:
        """See `Detector.detect`."""
        if self._name == "akaze":
            return detect(pixels, cv2.AKAZE_create())
        return detect(pixels, cv2.ORB_create(nfeatures=MOST_ORB_KEYPOINTS))


@DETECTORS.register("asift")
class Asift:
    """RootSIFT keypoints of 43 simulated views, tilted by up to 5.7 (Morel and Yu, 2009)."""

    def __init__(self, name: str, settings: Settings) -> None:
        pass

    def detect(self, pixels: RGBPixels) -> Keypoints:
        """See `Detector.detect`; one point of the scene may be found in several views."""
        found = root_sift(detect(pixels, cv2.AffineFeature_create(sift(most=MOST_OF_A_VIEW))))
        height, width = pixels.shape[:2]
        last = [width - 0.5, height - 0.5]
        return found[np.all((found.xy >= -0.5) & (found.xy <= last), axis=1)]
