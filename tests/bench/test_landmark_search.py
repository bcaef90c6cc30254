"""Ranks and average precision."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from nearfar.bench.studies.landmark_search import average_precision, first_correct

RANKINGS = st.lists(st.booleans(), max_size=30).map(lambda right: np.array(right, np.bool_))


def test_examples() -> None:
    right = np.array([False, True, False, True])
    assert first_correct(right) == 2
    assert average_precision(right, 2) == pytest.approx((1 / 2 + 2 / 4) / 2)
    assert average_precision(right, 4) == pytest.approx((1 / 2 + 2 / 4) / 4)
    assert first_correct(right[:1]) is None
    assert first_correct(right[:0]) is None
    assert average_precision(right[:1], 3) == 0


@given(RANKINGS)
def test_average_precision_is_one_for_a_perfect_ranking_alone(right: NDArray[np.bool_]) -> None:
    wanted = int(right.sum())
    if wanted:
        found = average_precision(right, wanted)
        assert 0 < found <= 1
        assert (found == pytest.approx(1)) == right[:wanted].all()
        assert average_precision(right, wanted + 1) < found
        assert found <= average_precision(np.sort(right)[::-1], wanted) + 1e-12


@given(RANKINGS)
def test_the_first_correct_answer_is_right(right: NDArray[np.bool_]) -> None:
    rank = first_correct(right)
    if rank is None:
        assert not right.any()
    else:
        assert right[rank - 1]
        assert not right[: rank - 1].any()
