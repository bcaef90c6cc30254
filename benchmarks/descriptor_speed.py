"""How fast descriptors describe landmarks, and map whole images, side by side in one run.

    python benchmarks/descriptor_speed.py [--descriptor nearfar hog ...] [--weights NAME=FILE ...]

Crops of a photograph of scikit-image, and that photograph at 1200x900; the best of five rounds.
"""

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
from skimage import data

from nearfar.cli.options import with_weights
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.settings import Settings

BOXES = 320


def best_seconds(run: Callable[[], object]) -> float:
    """Least time of five rounds."""
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def main() -> None:
    """Measure and print a line a descriptor."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--descriptor", nargs="+", default=["nearfar", "hog"])
    parser.add_argument("--weights", nargs="+", default=[])
    arguments = parser.parse_args()
    settings = with_weights(Settings(), tuple(arguments.weights))
    pixels = np.asarray(cv2.resize(data.astronaut(), (1200, 900)))
    rng = np.random.default_rng(0)
    places = rng.integers(0, [1100, 800], (BOXES, 2))
    boxes = np.hstack([places, rng.integers(30, 100, (BOXES, 2))]).astype(np.int32)
    for name in arguments.descriptor:
        descriptor = DESCRIPTORS.create(name, settings)
        crops = BOXES / best_seconds(lambda: descriptor.describe(pixels, boxes))  # noqa: B023
        line = f"{name}: {descriptor.dimensions} values, {crops:.0f} crops a second"
        if isinstance(descriptor, DenseDescriptor):
            seconds = best_seconds(lambda: descriptor.feature_map(pixels))  # noqa: B023
            line += f", {seconds:.3f} s for the map of 1200x900"
        print(line)


if __name__ == "__main__":
    main()
