"""Stages of the method `adaptive` as ratios to SIFT on the same photograph: a regression guard.

Run with `pytest benchmarks/test_adaptive_stages.py -n 0`. A stage fails that takes more times the
reference than `LIMITS` allows, about twice what it took when the limit was set. One thread is used.
"""

import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from skimage import data

from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.features.detection import detect_rootsift
from nearfar.imaging.mask import MaskedImage
from nearfar.methods.adaptive.alignment import align
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.preview import Preview
from nearfar.methods.adaptive.search import Pyramid, pyramid, search, templates, upsampled
from nearfar.methods.adaptive.simulated_views import ALL_AROUND, view_keypoints
from nearfar.methods.adaptive.zoom import region
from nearfar.settings import Settings

LIMITS = {
    "pyramid": 4.0,
    "upsampled pyramid": 9.0,
    "search": 1.6,
    "preview": 0.3,
    "zoom": 1.0,
    "alignment of 20": 8.0,
    "views": 7.0,
    "added views": 5.0,
}
"""Largest ratio of the CPU time of a stage to that of the reference."""
ROUNDS = 2
PLACE = Hypothesis(np.diag([0.6, 0.6, 1.0]), 0.0, "landmarks")


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def photograph(name: str) -> MaskedImage:
    image = np.ascontiguousarray(getattr(data, name)()[..., :3])
    resized: RGBPixels = cv2.resize(image, (1200, 900), interpolation=cv2.INTER_CUBIC)
    return MaskedImage(resized)


@pytest.fixture(scope="module")
def stages() -> dict[str, Callable[[], object]]:
    """Each stage on two unrelated photographs, by its name in `LIMITS`."""
    far, near = photograph("coffee"), photograph("rocket")
    descriptor = DESCRIPTORS.create("nearfar", Settings())
    assert isinstance(descriptor, DenseDescriptor)
    features: Pyramid = pyramid(far, descriptor)
    turned = templates(near, descriptor)
    sought = search(features, turned, near.size, 20)
    full = region(far, near, PLACE.far_from_near)
    assert full is not None
    return {
        "pyramid": lambda: pyramid(far, descriptor),
        "upsampled pyramid": lambda: upsampled(features, far, descriptor),
        "search": lambda: search(features, turned, near.size, DEFAULT.ladder.aligned),
        "preview": lambda: Preview(far, near, DEFAULT.zoom).matches(PLACE),
        "zoom": lambda: region(far, near, PLACE.far_from_near).matches(DEFAULT.zoom.reach),  # type: ignore[union-attr]
        "alignment of 20": lambda: align(far, near, sought, descriptor, features),
        "views": lambda: view_keypoints(far, ALL_AROUND[0]),
        "added views": lambda: view_keypoints(far, ALL_AROUND[1], part=1),
    }


def cpu_seconds(stage: Callable[[], object]) -> float:
    taken = []
    for _ in range(ROUNDS):
        start = time.process_time()
        stage()
        taken.append(time.process_time() - start)
    return min(taken)


@pytest.mark.parametrize("name", LIMITS)
def test_a_stage_keeps_its_ratio_to_sift(
    benchmark: BenchmarkFixture, stages: dict[str, Callable[[], object]], name: str
) -> None:
    image = photograph("coffee").pixels
    reference = cpu_seconds(lambda: detect_rootsift(image))
    taken = cpu_seconds(stages[name])
    benchmark.extra_info["ratio"] = round(taken / reference, 2)
    benchmark.pedantic(stages[name], rounds=1)  # type: ignore[no-untyped-call]
    assert taken < LIMITS[name] * reference
