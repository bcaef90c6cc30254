import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.arrays import Matrix3
from nearfar.geometry.homography import transform
from nearfar.maps.landmarks import DIMENSIONS, Landmarks
from nearfar.maps.search import NONE, Hits
from nearfar.maps.voting import find_hypotheses, votes_of

SIZE = (640, 480)
RIGHT, OTHERS = 7, (1, 2, 3)


def similarity_transform(scale: float, angle: float, x: float, y: float) -> Matrix3:
    """The middle of the query comes to lie at (x, y)."""
    cos, sin = scale * math.cos(angle), scale * math.sin(angle)
    middle = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2])
    linear = np.array([[cos, -sin], [sin, cos]])
    return np.vstack([np.column_stack([linear, np.array([x, y]) - linear @ middle]), [0, 0, 1]])


def query_landmarks(rng: np.random.Generator, count: int) -> Landmarks:
    angle = np.radians(45 * rng.integers(0, 8, count))
    side = 64 * math.sqrt(2) ** rng.integers(0, 5, count)
    vectors = np.zeros((count, DIMENSIONS), np.float16)
    return Landmarks(rng.uniform(0, SIZE, (count, 2)), side, angle, vectors)


def random_hits(rng: np.random.Generator, own: Landmarks, count: int) -> Hits:
    """Hits anywhere in images of 2000x2000 pixels, none much better than the last."""
    similarity = -np.sort(-rng.uniform(0.6, 0.7, (len(own), count)))
    image = rng.choice(OTHERS, (len(own), count))
    place = rng.uniform([0, 0, 64], [2000, 2000, 500], (len(own), count, 3))
    return Hits(similarity.astype(np.float32), image, place.astype(np.float32))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 1000),
    scale=st.floats(0.1, 3),
    turn=st.integers(0, 7),
    x=st.floats(0, 2000),
    y=st.floats(0, 2000),
)
def test_agreeing_hits_win_over_more_that_do_not(
    seed: int, scale: float, turn: int, x: float, y: float
) -> None:
    rng = np.random.default_rng(seed)
    angle = math.radians(45 * turn)
    truth = similarity_transform(scale, angle, x, y)
    own = query_landmarks(rng, 200)
    hits = random_hits(rng, own, 20)
    right = np.flatnonzero(np.isclose(np.cos(own.angle - angle), 1))[:12]
    hits.similarity[right, 0] = 0.85
    hits.image[right, 0] = RIGHT
    hits.place[right, 0, :2] = transform(truth, own.centre[right])
    hits.place[right, 0, 2] = scale * own.side[right]
    best = find_hypotheses(votes_of(hits, own, SIZE), SIZE, 10)[0]
    assert best.image == RIGHT
    corners = np.array([[0, 0], [639, 0], [639, 479], [0, 479.0]])
    away = transform(best.map_from_query, corners) - transform(truth, corners)
    assert np.hypot(*away.T).max() < 0.02 * scale * math.hypot(*SIZE)


def test_one_part_of_a_query_counts_once() -> None:
    """Many hits of one window weigh less than one hit each of a few windows."""
    rng = np.random.default_rng(0)
    drawn = query_landmarks(rng, 40)
    own = Landmarks(drawn.centre, drawn.side, np.zeros(40), drawn.vectors)
    hits = random_hits(rng, own, 20)
    truth = similarity_transform(0.5, 0, 500, 500)
    for image, rows, ranks in ((8, slice(0, 1), 19), (RIGHT, slice(1, 4), 1)):
        hits.similarity[rows, :ranks], hits.image[rows, :ranks] = 0.9, image
        hits.place[rows, :ranks, :2] = transform(truth, own.centre[rows])[:, np.newaxis]
        hits.place[rows, :ranks, 2] = 0.5 * own.side[rows, np.newaxis]
    found = find_hypotheses(votes_of(hits, own, SIZE), SIZE, 10)
    votes = {each.image: each.votes for each in reversed(found)}
    assert votes[RIGHT] > 2 * votes[8]


def test_no_hits() -> None:
    own = query_landmarks(np.random.default_rng(0), 3)
    none = Hits(
        np.full((3, 5), -1, np.float32),
        np.full((3, 5), NONE, np.int64),
        np.zeros((3, 5, 3), np.float32),
    )
    assert find_hypotheses(votes_of(none, own, SIZE), SIZE, 10) == []
    nothing = Hits(none.similarity[:0], none.image[:0], none.place[:0])
    assert find_hypotheses(votes_of(nothing, own[np.empty(0, np.intp)], SIZE), SIZE, 10) == []


@pytest.mark.parametrize("count", [1, 2])
def test_a_map_of_few_landmarks(count: int) -> None:
    """Even where each landmark of the map is a hit, the votes count."""
    own = query_landmarks(np.random.default_rng(0), count)
    similarity = np.full((count, 5), -1, np.float32)
    image, place = np.full((count, 5), NONE, np.int64), np.zeros((count, 5, 3), np.float32)
    similarity[:, 0], image[:, 0], place[:, 0] = 0.9, RIGHT, [300, 300, 64]
    assert (
        find_hypotheses(votes_of(Hits(similarity, image, place), own, SIZE), SIZE, 10)[0].image
        == RIGHT
    )


def test_a_landmark_that_is_like_everything_weighs_little() -> None:
    """Each window of the query hits one landmark of one image, and several of another."""
    rng = np.random.default_rng(0)
    drawn = query_landmarks(rng, 40)
    own = Landmarks(drawn.centre, drawn.side, np.zeros(40), drawn.vectors)
    hits = random_hits(rng, own, 20)
    truth = similarity_transform(0.5, 0, 500, 500)
    hits.similarity[:, 0], hits.image[:, 0] = 0.9, 8
    hits.place[:, 0] = [500, 500, 100]
    hits.similarity[:10, 1], hits.image[:10, 1] = 0.85, RIGHT
    hits.place[:10, 1, :2] = transform(truth, own.centre[:10])
    hits.place[:10, 1, 2] = 0.5 * own.side[:10]
    votes = votes_of(hits, own, SIZE)
    assert len(votes) == hits.image.size - len(own)
    assert votes.weight[votes.image == 8].max() < 0.3 * votes.weight[votes.image == RIGHT].min()
    assert find_hypotheses(votes, SIZE, 10)[0].image == RIGHT


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), most=st.integers(1, 12))
def test_fewer_candidates_are_the_first_of_more(seed: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    own = query_landmarks(rng, 60)
    votes = votes_of(random_hits(rng, own, 5), own, SIZE)
    every = find_hypotheses(votes, SIZE, 10**6)
    few = find_hypotheses(votes, SIZE, most)
    assert [each.votes for each in few] == [each.votes for each in every[:most]]
