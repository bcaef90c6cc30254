"""ALIKED and LightGlue from ONNX files, which need no more than nearfar itself.

The files are those that COLMAP 4 publishes and reads, so that one download serves both. The points
are those of ALIKED-n16rot, which bears rotations better than ALIKED-n16.
"""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.errors import WeightsError
from nearfar.features import MATCHERS
from nearfar.features.keypoints import ImageMatches
from nearfar.features.learned.detector import Detected, LearnedDetector, LearnedFeatures
from nearfar.runtime.onnx import session
from nearfar.runtime.weight_files import weights_file
from nearfar.settings import Settings

if TYPE_CHECKING:
    import onnxruntime

DETECTOR, MATCHER = "aliked-onnx", "aliked-lightglue-onnx"
"""The two networks, as settings call them."""
INPUTS = {
    DETECTOR: ("image", "max_keypoints", "min_score"),
    MATCHER: ("kpts0", "kpts1", "desc0", "desc1", "image_size0", "image_size1"),
}
OUTPUTS = {DETECTOR: ("keypoints", "descriptors", "scores"), MATCHER: ("matches0", "mscores0")}
"""Names in the files, in their order."""


@MATCHERS.register("aliked-lightglue-onnx")
class OnnxMatcher(LearnedDetector):
    """LightGlue (Lindenberger et al., 2023) for points of ALIKED (Zhao et al., 2023), by ONNX.

    Raises:
        WeightsError: a file is missing; the message says how to fetch it.
    """

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        super().__init__(128, settings.constants.learned)
        self._files = {each: weights_file(each, settings) for each in (DETECTOR, MATCHER)}
        self._device = settings.device

    def match_images(self, far: LearnedFeatures, near: LearnedFeatures) -> ImageMatches:
        """See `ImageMatcher.match_images`."""
        one, other = far.keypoints, near.keypoints
        if not len(one) or not len(other):
            return ImageMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
        values = [
            *(each.xy[np.newaxis].astype(np.float32) for each in (one, other)),
            *(each.descriptors[np.newaxis].astype(np.float32) for each in (one, other)),
            *(each.size[np.newaxis].astype(np.float32) for each in (far, near)),
        ]
        matched, score = self._run(MATCHER, values)
        i = np.flatnonzero(matched >= 0)
        j = matched[i].astype(np.intp)
        return ImageMatches(one.xy[i], other.xy[j], score[i].astype(np.float64))

    def _detected(self, pixels: RGBPixels) -> Detected:
        image = pixels.transpose(2, 0, 1)[np.newaxis].astype(np.float32) / 255
        limits = self._constants
        values = [image, np.array(limits.most_points), np.array(limits.least_score, np.float32)]
        xy, descriptors, score = (each[0] for each in self._run(DETECTOR, values))
        last = np.array(pixels.shape[1::-1], np.float32) - 1
        return (xy + 1) / 2 * last, descriptors, score

    def _run(self, network: str, values: Sequence[NDArray[Any]]) -> list[NDArray[np.float32]]:
        model = _loaded(network, self._files[network], self._device)
        known = {each.name for each in model.get_inputs()}
        named = zip(INPUTS[network], values, strict=True)
        inputs = {name: value for name, value in named if name in known}
        return list(model.run(list(OUTPUTS[network]), inputs))


@functools.cache
def _loaded(network: str, file: Path, device: str) -> "onnxruntime.InferenceSession":
    """Return a session for a file with the expected outputs, loaded once in a process.

    Raises:
        SettingsError: ONNX Runtime has no provider for the device.
        WeightsError: the file cannot be read, or is no such network.
    """
    try:
        model = session(file.read_bytes(), device)
    except OSError as error:
        raise WeightsError(f"{file} cannot be read: {error.strerror}") from error
    names = [each.name for each in (*model.get_inputs(), *model.get_outputs())]
    needed = (INPUTS[network][0], *OUTPUTS[network])
    if not set(needed) <= set(names):
        raise WeightsError(f"{file} is no {network} as COLMAP 4 reads it: it lacks {needed}")
    return model
