"""Matchers of images with learned features; `nearfar.features.learned.networks` loads them."""

from pathlib import Path
from typing import Any

import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.features import MATCHERS
from nearfar.features.keypoints import ImageMatches
from nearfar.features.learned.detector import Detected, LearnedDetector, LearnedFeatures
from nearfar.features.learned.networks import detector, device_of, lightglue
from nearfar.features.learned.weights import check_installed
from nearfar.settings import Settings

DIMENSIONS = {"aliked": 128, "disk": 128, "xfeat": 64}
"""Numbers of a descriptor, by the network."""


class _Learned(LearnedDetector):
    """Finds points with a network of kornia; the classes below match them."""

    def __init__(self, name: str, networks: list[str], settings: Settings) -> None:
        self._own = {each: Path(file) for each, file in settings.weights.items()}
        check_installed(name, networks, self._own)
        super().__init__(DIMENSIONS[networks[0]], settings.constants.learned)
        self._name, self._network = name, networks[0]
        self._device = settings.device

    def _detected(self, pixels: RGBPixels) -> Detected:
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
