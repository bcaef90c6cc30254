"""A localization as JSON: read back it is the same, and what is damaged is refused."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearfar import (
    ImageInfo,
    LandmarkMatches,
    Localization,
    LocalizationError,
    PointMatches,
    RelativePose,
)
from nearfar.arrays import Matrix3
from nearfar.models import FAILURE_KINDS, MODEL_KINDS, Candidate
from nearfar.verification.expected_error import ExpectedError, ValidRegion

NUMBERS = st.floats(-1e9, 1e9)
MATRICES = st.lists(NUMBERS, min_size=9, max_size=9).map(lambda x: np.array(x).reshape(3, 3))
TEXTS = st.none() | st.text(max_size=20)
IMAGES = st.builds(
    lambda path, width, height: ImageInfo(path, width, height, (width, height)),
    st.none() | st.just("folder/image.png"),
    st.integers(1, 10**5),
    st.integers(1, 10**5),
)
SIZES = st.floats(0, 1e6)
REGIONS = st.builds(
    ValidRegion,
    MATRICES.map(lambda matrix: np.resize(matrix, (3, 2))),
    st.floats(0, 1),
    st.none() | SIZES,
    st.none() | SIZES,
)
EXPECTED = st.builds(
    ExpectedError, SIZES, st.tuples(SIZES, SIZES, SIZES, SIZES), region=st.none() | REGIONS
) | st.builds(ExpectedError, rotation=SIZES, direction=SIZES)


@st.composite
def localizations(draw: st.DrawFn) -> Localization:
    """Answers of every kind, failures among them."""
    kind = draw(st.sampled_from(MODEL_KINDS))
    model: Matrix3 | RelativePose | None = None
    if draw(st.booleans()):
        matrix = draw(MATRICES)
        covariance = draw(st.none() | MATRICES.map(lambda matrix: np.resize(matrix, (6, 6))))
        model = RelativePose(matrix, matrix[0], covariance) if kind == "pose" else matrix
    count = draw(st.integers(0, 5))
    points = PointMatches(np.ones((count, 2)), np.ones((count, 2)), np.arange(count) % 2 == 0)
    boxes = np.ones((draw(st.integers(0, 3)), 4), np.int32)
    candidates = st.builds(Candidate, MATRICES, st.none() | st.floats(0, 1), st.text(max_size=9))
    return Localization(
        status="failed" if model is None else "localized",
        reason=draw(TEXTS),
        failure=draw(st.none() | st.sampled_from(FAILURE_KINDS)),
        candidates=tuple(draw(st.lists(candidates, max_size=2))),
        model=kind,
        far_from_near=model,
        scale_change=draw(st.none() | NUMBERS),
        confidence=draw(st.none() | st.floats(0, 1)),
        log10_nfa=draw(st.none() | NUMBERS),
        footprint=draw(st.none() | MATRICES.map(lambda matrix: np.resize(matrix, (4, 2)))),
        points=points,
        landmarks=LandmarkMatches(boxes, boxes, np.ones(len(boxes), np.float32)),
        seconds=draw(st.dictionaries(st.text(max_size=9), st.floats(0, 1e4), max_size=3)),
        method=draw(st.text(min_size=1, max_size=9)),
        step=draw(TEXTS),
        descriptor=draw(TEXTS),
        far=draw(IMAGES),
        near=draw(IMAGES),
        expected_error=draw(st.none() | EXPECTED),
    )


@given(localizations())
def test_what_is_read_back_is_the_same(found: Localization) -> None:
    content = json.loads(found.to_json())
    again = Localization.from_dict(content, found.points, found.landmarks)
    assert again.to_dict() == found.to_dict() == content
    assert (again.far.width, again.near.height) == (found.far.width, found.near.height)
    assert type(again.far_from_near) is type(found.far_from_near)
    alone = Localization.from_dict(content)
    assert len(alone.points) == len(alone.landmarks) == 0


@given(localizations(), st.data())
def test_what_lacks_a_part_is_refused(found: Localization, data: st.DataObject) -> None:
    content = found.to_dict()
    optional = {"inliers", "matches", "landmark_matches", "agreement", "excluded", "alternatives"}
    optional |= {"candidates", "failure", "expected_error", "mirrored", "intrinsics"}
    del content[data.draw(st.sampled_from(sorted(set(content) - optional)))]
    with pytest.raises(LocalizationError, match="to_dict"):
        Localization.from_dict(content)


WHOLE: dict[str, Any] = {
    "status": "localized", "reason": None, "model": "homography",
    "far_from_near": {"homography": np.eye(3).tolist()}, "scale_change": 2.0, "confidence": 0.5,
    "log10_nfa": -9.0, "footprint": None, "method": "sift", "step": None,
    "descriptor": None, "seconds": {"points": 0.1},
    "far": {"path": None, "width": 4, "height": 3}, "near": {"path": "x", "width": 4, "height": 3},
}  # fmt: skip


PIXELS = {"mean": 1.0, "corners": None, "rotation": None, "direction": None, "region": None}


@pytest.mark.parametrize(
    "damage",
    [
        {"status": "failed"}, {"status": "error"}, {"far_from_near": None}, {"model": "affinity"},
        {"model": "pose"}, {"far_from_near": {"homography": [[1, 0], [0, 1]]}},
        {"far_from_near": {"homography": [[np.nan] * 3] * 3}}, {"far_from_near": "homography"},
        {"footprint": [[0, 0]] * 3}, {"scale_change": "2"}, {"confidence": np.inf},
        {"confidence": True}, {"reason": 5}, {"step": ["views"]}, {"seconds": [1]},
        {"seconds": {"points": None}}, {"far": None}, {"far": {"path": None, "width": 4}},
        {"near": {"path": 4, "width": 4, "height": 3}},
        {"near": {"path": None, "width": 0, "height": 3}},
        {"near": {"path": None, "width": 4.5, "height": 3}},
        {"near": {"path": None, "width": 4, "height": 3, "bands": [1, 2]}},
        {"near": {"path": None, "width": 4, "height": 3, "channels": "hsv"}},
        {"failure": "bad luck"}, {"candidates": [{"homography": [[1]], "score": 1, "source": "x"}]},
        {"expected_error": {}},
        {"expected_error": PIXELS | {"mean": np.nan}},
        {"expected_error": PIXELS | {"corners": [1]}},
    ],
    ids=str,
)  # fmt: skip
def test_what_is_damaged_is_refused(damage: dict[str, Any]) -> None:
    assert Localization.from_dict(WHOLE).localized
    with pytest.raises(LocalizationError, match="to_dict"):
        Localization.from_dict(WHOLE | damage)


@pytest.mark.parametrize("content", [None, [], "localized", {}])
def test_what_is_no_object_is_refused(content: Any) -> None:
    with pytest.raises(LocalizationError, match="to_dict"):
        Localization.from_dict(content)
