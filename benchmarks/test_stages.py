"""Share of each stage of the paper's method on a pair of 1200x900 photographs.

Run with `pytest benchmarks -n 0`: one row a stage, with its ratio to the fastest one.
"""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from skimage import data

from nearfar.arrays import Boxes, RGBPixels
from nearfar.descriptors.handcrafted import HOG
from nearfar.estimators.opencv import Ransac
from nearfar.features.detection import detect_sift
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import match_mnn, match_mnn_in_boxes
from nearfar.landmarks import Landmarks, match_landmarks
from nearfar.models import Task
from nearfar.proposals.selective_search import SelectiveSearch
from nearfar.settings import Settings

SETTINGS = Settings()


def photograph(name: str) -> RGBPixels:
    image = np.ascontiguousarray(getattr(data, name)()[..., :3])
    resized: RGBPixels = cv2.resize(image, (1200, 900), interpolation=cv2.INTER_CUBIC)
    return resized


@pytest.fixture(scope="module")
def images() -> tuple[RGBPixels, RGBPixels]:
    return photograph("coffee"), photograph("rocket")


@pytest.fixture(scope="module")
def landmarks(images: tuple[RGBPixels, RGBPixels]) -> list[Landmarks]:
    found = []
    for image in images:
        boxes = SelectiveSearch("selective-search", SETTINGS).propose(image)
        found.append(Landmarks(boxes, HOG("hog", SETTINGS).describe(image, boxes)))
    return found


@pytest.fixture(scope="module")
def points(images: tuple[RGBPixels, RGBPixels]) -> list[Keypoints]:
    return [detect_sift(image) for image in images]


def once(benchmark: BenchmarkFixture, stage: Callable[[], object]) -> None:
    benchmark.pedantic(stage, rounds=3, warmup_rounds=1)  # type: ignore[no-untyped-call]


@pytest.mark.benchmark(group="per image")
def test_proposals(benchmark: BenchmarkFixture, images: tuple[RGBPixels, RGBPixels]) -> None:
    proposer = SelectiveSearch("selective-search", SETTINGS)
    once(benchmark, lambda: proposer.propose(images[0]))


@pytest.mark.benchmark(group="per image")
def test_proposals_at_half_size(
    benchmark: BenchmarkFixture, images: tuple[RGBPixels, RGBPixels]
) -> None:
    proposer = SelectiveSearch("selective-search", SETTINGS.replace(proposal_max_size=600))
    once(benchmark, lambda: proposer.propose(images[0]))


@pytest.mark.benchmark(group="per image")
def test_descriptors(
    benchmark: BenchmarkFixture, images: tuple[RGBPixels, RGBPixels], landmarks: list[Landmarks]
) -> None:
    boxes: Boxes = landmarks[0].boxes
    once(benchmark, lambda: HOG("hog", SETTINGS).describe(images[0], boxes))


@pytest.mark.benchmark(group="per image")
def test_points(benchmark: BenchmarkFixture, images: tuple[RGBPixels, RGBPixels]) -> None:
    once(benchmark, lambda: detect_sift(images[0]))


@pytest.mark.benchmark(group="per pair")
def test_landmark_matching(benchmark: BenchmarkFixture, landmarks: list[Landmarks]) -> None:
    once(benchmark, lambda: match_landmarks(*landmarks))


@pytest.mark.benchmark(group="per pair")
def test_point_matching(benchmark: BenchmarkFixture, points: list[Keypoints]) -> None:
    once(benchmark, lambda: match_mnn(*points))


@pytest.mark.benchmark(group="per pair")
def test_point_matching_in_boxes(
    benchmark: BenchmarkFixture, points: list[Keypoints], landmarks: list[Landmarks]
) -> None:
    matches = match_landmarks(*landmarks)
    far, near = points
    once(
        benchmark,
        lambda: match_mnn_in_boxes(far, near, matches.far_boxes, matches.near_boxes),
    )


@pytest.mark.benchmark(group="per pair")
def test_estimation(benchmark: BenchmarkFixture, points: list[Keypoints]) -> None:
    far, near = match_mnn(*points).T
    estimator = Ransac("ransac", SETTINGS)
    task = Task("homography")
    once(benchmark, lambda: estimator.estimate(points[0].xy[far], points[1].xy[near], task))
