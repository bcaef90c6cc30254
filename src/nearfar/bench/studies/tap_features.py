"""Descriptors of several outputs of a network at once, stored in files for the sweep."""

import hashlib
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import Boxes, RGBPixels, Vectors
from nearfar.errors import SettingsError
from nearfar.features import DETECTORS
from nearfar.features.keypoints import Keypoints
from nearfar.landmarks import LandmarkLayers, Landmarks
from nearfar.methods.paper import PaperFeatures, PaperSteps
from nearfar.models import Answer, Task
from nearfar.networks import resnet50, squeezenet
from nearfar.networks.runner import CropNetwork
from nearfar.networks.weights import read_weights
from nearfar.proposals import PROPOSERS
from nearfar.runtime.timing import StageTimer
from nearfar.runtime.weight_files import weights_file
from nearfar.settings import Settings

_VALUE_BYTES = np.dtype(np.float16).itemsize


class Describer(Protocol):
    """Describes boxes by several outputs, like `nearfar.networks.runner.CropNetwork`."""

    @property
    def dimensions(self) -> tuple[int, ...]:
        """Return the number of values of each output for one box."""
        ...

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> list[NDArray[np.float16]]:
        """Return (N, D) vectors of unit length for each output."""
        ...


class VectorFile:
    """The vectors of all outputs of a network for the boxes of an image, in a temporary file.

    Args:
        network: describes the boxes.
        pixels: the working image.
        boxes: (N, 4) boxes inside the image.
        folder: folder of the file.
        batch_size: number of boxes whose vectors are in memory at a time.

    Raises:
        OSError: the disk is full.
    """

    def __init__(
        self, network: Describer, pixels: RGBPixels, boxes: Boxes, folder: Path, batch_size: int
    ) -> None:
        self._count = len(boxes)
        self._dimensions = network.dimensions
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        starts = self._starts()
        for first in range(0, len(boxes), batch_size):
            batch = network.describe(pixels, boxes[first : first + batch_size])
            for start, vectors in zip(starts, batch, strict=False):
                self._file.seek(start + first * vectors.shape[1] * _VALUE_BYTES)
                self._file.write(vectors.data)
        self._file.flush()

    @property
    def nbytes(self) -> int:
        """Return the size of the file in bytes."""
        return self._starts()[-1]

    def vectors(self, output: int) -> Vectors:
        """Return the (N, D) float16 vectors of one output, a read-only map of the file."""
        shape = self._count, self._dimensions[output]
        if self._count == 0:
            return np.empty(shape, np.float16)
        return np.memmap(self._file, np.float16, "r", self._starts()[output], shape)

    def _starts(self) -> list[int]:
        """Return the offset of each output in the file, and the end of the last one, in bytes."""
        lengths = (self._count * length * _VALUE_BYTES for length in self._dimensions)
        return list(accumulate(lengths, initial=0))


LEAST_KEPT = 2
"""Number of images, those of one pair, whose vectors are kept whatever their size."""
MOST_KEPT = 100
"""Largest number of images whose boxes and points, or vectors of one crop size, are kept."""


@dataclass(frozen=True)
class Network:
    """A network whose outputs are descriptors.

    Attributes:
        layers: names of the outputs, first to last.
        sizes: sides of the crops in pixels, largest first.
        model: weights, names of outputs, side of the crops -> ONNX model.
    """

    layers: tuple[str, ...]
    sizes: tuple[int, ...]
    model: Callable[[Mapping[str, NDArray[Any]], Sequence[str], int], bytes]


NETWORKS = {
    "resnet50": Network(resnet50.TAPS, resnet50.SIZES, resnet50.resnet50_model),
    "squeezenet": Network(squeezenet.TAPS, squeezenet.SIZES, squeezenet.squeezenet_model),
}


class Tap(NamedTuple):
    """One output of a network for crops of one size."""

    network: str
    layer: str
    size: int

    @property
    def name(self) -> str:
        """Return the name of the descriptor."""
        return f"{self.network}-{self.layer}@{self.size}"


def taps_of(descriptor: str) -> tuple[Tap, ...]:
    """Return the outputs in the name of a descriptor, which may join several by "+".

    Raises:
        SettingsError: a part of the name is no output of a network.
    """
    taps = []
    for name in descriptor.split("+"):
        network, _, rest = name.partition("-")
        layer, _, size = rest.partition("@")
        known = NETWORKS.get(network)
        if known is None or layer not in known.layers or size not in map(str, known.sizes):
            raise SettingsError(
                f"{name!r} is not an output of a network, such as resnet50-res3d@64"
            )
        taps.append(Tap(network, layer, int(size)))
    return tuple(taps)


_Source = tuple[str, int]
"""A network and the side of its crops."""


class TapFeatures:
    """Boxes, points and vectors of images, each computed once while it is kept.

    Args:
        taps: all outputs that will be needed; those of one network and size come from one pass.
        settings: proposer, detector of points, weights, batch size and filter of crops.
        folder: folder for the vectors while they are needed.
        disk_bytes: limit on their size, beyond the images of one pair.

    Raises:
        WeightsError: weights are missing or do not fit.
    """

    def __init__(
        self, taps: Sequence[Tap], settings: Settings, folder: Path, disk_bytes: int
    ) -> None:
        self._proposer = PROPOSERS.create(settings.proposer, settings)
        self._points = DETECTORS.create(settings.landmark_detector, settings)
        self._folder = folder
        self._batch_size = settings.batch_size
        self._layers: dict[_Source, list[str]] = {}
        for tap in dict.fromkeys(taps):
            self._layers.setdefault((tap.network, tap.size), []).append(tap.layer)
        tensors = {
            network: read_weights(weights_file(network, settings)) for network, _ in self._layers
        }
        self._networks = {
            (network, size): CropNetwork(
                NETWORKS[network].model(tensors[network], layers, size),
                settings.batch_size,
                antialias=settings.antialias,
            )
            for (network, size), layers in self._layers.items()
        }
        self._images: LRUCache[str, tuple[Boxes, Keypoints]] = LRUCache(MOST_KEPT)
        self._pair: LRUCache[tuple[str, _Source], VectorFile] = LRUCache(LEAST_KEPT)
        self._vectors: LRUCache[tuple[str, _Source], VectorFile] = LRUCache(
            disk_bytes, getsizeof=lambda found: max(found.nbytes, disk_bytes // MOST_KEPT)
        )

    def extract(self, pixels: RGBPixels, taps: Sequence[Tap], timer: StageTimer) -> PaperFeatures:
        """Extract the features of an image for method `paper`, with some outputs as descriptors."""
        image = hashlib.sha256(repr(pixels.shape).encode() + pixels.tobytes()).hexdigest()
        if image not in self._images:
            self._images[image] = self._detect(pixels, timer)
        boxes, points = self._images[image]
        layers = []
        for tap in taps:
            source = tap.network, tap.size
            vectors = self._vectors_of(image, source, pixels, boxes, timer)
            output = self._layers[source].index(tap.layer)
            layers.append(Landmarks(boxes, vectors.vectors(output)))
        return PaperFeatures(LandmarkLayers(tuple(layers)), points)

    def _vectors_of(
        self, image: str, source: _Source, pixels: RGBPixels, boxes: Boxes, timer: StageTimer
    ) -> VectorFile:
        """Return the vectors of the boxes of an image, computed where they are not kept."""
        key = image, source
        found = self._pair.get(key) or self._vectors.get(key)
        if found is None:
            with timer.stage("descriptors"):
                network = self._networks[source]
                found = VectorFile(network, pixels, boxes, self._folder, self._batch_size)
            if found.nbytes <= self._vectors.maxsize:
                self._vectors[key] = found
        self._pair[key] = found
        return found

    def _detect(self, pixels: RGBPixels, timer: StageTimer) -> tuple[Boxes, Keypoints]:
        with timer.stage("proposals"):
            boxes = self._proposer.propose(pixels)
        with timer.stage("points"):
            return boxes, self._points.detect(pixels)


class TapMethod:
    """Method `paper` or `objects` with features that other configurations share.

    Args:
        features: the shared features.
        taps: the outputs of this configuration.
        settings: the method and its settings.
    """

    uses_landmarks = True

    def __init__(self, features: TapFeatures, taps: Sequence[Tap], settings: Settings) -> None:
        self._features = features
        self._taps = taps
        self._steps = PaperSteps(settings)
        self._objects = settings.method == "objects"

    def extract(self, pixels: RGBPixels, timer: StageTimer) -> PaperFeatures:
        """See `Method.extract`."""
        return self._features.extract(pixels, self._taps, timer)

    def localize(
        self, far: PaperFeatures, near: PaperFeatures, task: Task, timer: StageTimer
    ) -> Answer:
        """See `Method.localize`."""
        if self._objects:
            return self._steps.objects(far.landmarks, near.landmarks, task, timer)
        return self._steps.points(far, near, task, timer)
