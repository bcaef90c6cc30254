"""Matchers of images with learned features; `nearfar.features.learned.networks` loads them."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.constants import LearnedConstants
from nearfar.features import MATCHERS
from nearfar.features.keypoints import ImageMatches, Keypoints
from nearfar.features.learned.networks import detector, device_of, lightglue
from nearfar.features.learned.weights import check_installed
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.mask import PixelMask, usable
from nearfar.settings import Settings

MULTIPLE = 32
"""Sides of the resized image are multiples of this, so that no network pads or resizes it again."""
DIMENSIONS = {"aliked": 128, "disk": 128, "xfeat": 64}
"""Numbers of a descriptor, by the network."""


@dataclass(frozen=True, eq=False)
class LearnedFeatures:
    """The learned keypoints of an image.

    Attributes:
        keypoints: positions in pixels of the image, descriptors and scores; they have neither
            scale nor angle.
        size: (2,) width and height of the image in pixels.
    """

    keypoints: Keypoints
    size: NDArray[np.int64]

    @property
    def nbytes(self) -> int:
        """Return the memory that the arrays take, in bytes."""
        return self.keypoints.nbytes + self.size.nbytes


class _Learned:
    """Finds points with a network; the classes below match them."""

    def __init__(self, name: str, networks: list[str], settings: Settings) -> None:
        self._own = {each: Path(file) for each, file in settings.weights.items()}
        check_installed(name, networks, self._own)
        self._name, self._network = name, networks[0]
        self._device = settings.device
        self._constants: LearnedConstants = settings.constants.learned

    def extract(self, pixels: RGBPixels) -> LearnedFeatures:
        """See `ImageMatcher.extract`.

        Raises:
            SettingsError: the device is not available here.
            WeightsError: the weights are missing or not the published ones.
        """
        height, width = pixels.shape[:2]
        size = np.array([width, height])
        if min(width, height) < self._constants.least_side or pixels.min() == pixels.max():
            empty = Keypoints.of(np.empty((0, 2)), np.empty((0, DIMENSIONS[self._network])))
            return LearnedFeatures(empty, size)
        seen = _fitted(pixels, self._constants.longest_side)
        xy, descriptors, score = self._detected(seen)
        to_seen = scaling(seen.shape[1] / width, seen.shape[0] / height)
        own = transform(np.linalg.inv(to_seen), xy.astype(np.float64))
        found = Keypoints.of(own, descriptors, score=score)
        return LearnedFeatures(found[usable(None, (width, height), own)], size)

    def masked(self, features: LearnedFeatures, mask: PixelMask) -> LearnedFeatures:
        """Return the features that a mask leaves."""
        kept = usable(mask, mask.shape[::-1], features.keypoints.xy)
        return replace(features, keypoints=features.keypoints[kept])

    def _detected(
        self, pixels: RGBPixels
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Return (N, 2) positions, (N, D) descriptors and (N,) scores."""
        import torch

        most = self._constants.most_points
        least, own = self._constants.least_score, self._own.get(self._network)
        network = detector(self._network, self._device, most, least, own)
        with torch.inference_mode():
            image = torch.from_numpy(pixels.copy()).permute(2, 0, 1)[None].float() / 255
            image = image.to(device_of(self._device))
            if self._network == "xfeat":
                table = network.detectAndCompute(image, top_k=most)[0]
                found = table["keypoints"], table["descriptors"], table["scores"]
            elif self._network == "disk":
                points = network(image, n=most, pad_if_not_divisible=True)[0]
                found = points.keypoints, points.descriptors, points.detection_scores
            else:
                points = network(image)[0]
                found = points.keypoints, points.descriptors, points.keypoint_scores
            xy, descriptors, score = (each.float().cpu().numpy() for each in found)
        return xy, descriptors, score


@MATCHERS.register("aliked-lightglue", "disk-lightglue", "xfeat-lighterglue")
class LightGlueMatcher(_Learned):
    """LightGlue (Lindenberger et al., 2023) for points of ALIKED, DISK or XFeat.

    LighterGlue is the smaller LightGlue of XFeat (Potje et al., 2024).

    Raises:
        MissingExtraError: torch or kornia is not installed.
        WeightsError: the package with the weights is not installed.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, [name.partition("-")[0], name], settings)

    def match_images(self, far: LearnedFeatures, near: LearnedFeatures) -> ImageMatches:
        """See `ImageMatcher.match_images`."""
        import torch

        if not len(far.keypoints) or not len(near.keypoints):
            return ImageMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
        with torch.inference_mode():
            network = lightglue(self._name, self._device, self._own.get(self._name))
            images = {"image0": self._tensors(far), "image1": self._tensors(near)}
            found = network(images)
            pairs = found["matches"][0].cpu().numpy()
            score = found["scores"][0].float().cpu().numpy()
        i, j = pairs.T
        return ImageMatches(far.keypoints.xy[i], near.keypoints.xy[j], score.astype(np.float64))

    def _tensors(self, features: LearnedFeatures) -> dict[str, Any]:
        import torch

        device = device_of(self._device)
        points = features.keypoints
        return {
            "keypoints": torch.from_numpy(points.xy).float()[None].to(device),
            "descriptors": torch.from_numpy(points.descriptors)[None].to(device),
            "image_size": torch.from_numpy(features.size)[None].to(device),
        }


@MATCHERS.register("xfeat")
class XFeatMatcher(_Learned):
    """Mutual nearest neighbours of XFeat points (Potje et al., 2024) with similar descriptors.

    Raises:
        MissingExtraError: torch or kornia is not installed.
        WeightsError: the package with the weights is not installed.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, ["xfeat"], settings)

    def match_images(self, far: LearnedFeatures, near: LearnedFeatures) -> ImageMatches:
        """See `ImageMatcher.match_images`; the score is the cosine of the descriptors."""
        one, other = far.keypoints, near.keypoints
        if not len(one) or not len(other):
            return ImageMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
        cosine = one.descriptors @ other.descriptors.T
        best = cosine.argmax(axis=1)
        each = np.arange(len(one))
        score = cosine[each, best]
        kept = (cosine.argmax(axis=0)[best] == each) & (score > self._constants.least_cosine)
        xy = one.xy[kept], other.xy[best[kept]]
        return ImageMatches(*xy, np.clip(score[kept].astype(np.float64), 0, 1))


def _fitted(pixels: RGBPixels, longest_side: int) -> RGBPixels:
    """Return the image resized so that its sides are multiples, and at most of this length."""
    height, width = pixels.shape[:2]
    factor = min(1.0, longest_side / max(width, height))
    size = [max(MULTIPLE, round(each * factor / MULTIPLE) * MULTIPLE) for each in (width, height)]
    mode = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(pixels, size, interpolation=mode))
