"""Votes of landmarks for where a query lies: hits -> hypotheses.

Each hit of a query landmark gives position, scale and rotation of the query in a map image. False
hits scatter, so hits that agree stand out.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.maps.landmarks import Landmarks
from nearfar.maps.search import NONE, Hits

SCALE_TOLERANCE = 1.5
"""Largest ratio of the scales of two votes that agree."""
ANGLE_TOLERANCE = math.radians(46)
"""Largest difference of the rotations of two votes that agree, in radians."""
PLACE_TOLERANCE = 0.25
"""Largest distance of the query's centre between two votes that agree, as a share of the diagonal
of its footprint."""
SEEDS = 40
"""Number of the best votes for an image that propose transforms."""
HYPOTHESES_PER_IMAGE = 3
"""Largest number of hypotheses in one map image."""


@dataclass(frozen=True, eq=False)
class Votes:
    """Hits as votes for similarity transforms.

    Attributes:
        image: (N,) ids of the map images.
        place: (N, 2) centre of the query, in pixels of the map image.
        scale: (N,) pixels of the map image per pixel of the query.
        angle: (N,) rotation from the query to the map image, in radians.
        weight: (N,) IDF-like weight of the hit, 0 to 1; see `votes_of`.
        cell: (N,) number of the part of the query that votes; each counts once for a hypothesis.
    """

    image: NDArray[np.int64]
    place: Coordinates
    scale: NDArray[np.float64]
    angle: NDArray[np.float64]
    weight: NDArray[np.float64]
    cell: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.weight)

    def __getitem__(self, chosen: Mask | NDArray[np.intp]) -> "Votes":
        return Votes(*(getattr(self, each.name)[chosen] for each in fields(self)))


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Where a query may lie, by votes.

    Attributes:
        image: id of the map image.
        map_from_query: affine transform between pixels of the original images: a similarity, after
            the transform to the simulated view of the query.
        votes: sum of the weights of the votes that support it.
    """

    image: int
    map_from_query: Matrix3
    votes: float


def votes_of(hits: Hits, landmarks: Landmarks, size: tuple[int, int]) -> Votes:
    """Turn hits into votes.

    The weight of a hit is IDF-like: ((s - s_K) / (1 - s_K))^2 / sqrt(c), where s is its similarity,
    s_K that of the last hit of the same query landmark, and c the number of cells of the query that
    hit the same map landmark. Structure that is found all over the map gets little weight.

    Args:
        hits: nearest neighbours of the landmarks.
        landmarks: landmarks of the query.
        size: width and height of the query, in pixels.
    """
    count = hits.similarity.shape[1]
    query = np.repeat(np.arange(len(landmarks)), count)
    last = hits.similarity[:, -1:]
    excess = (hits.similarity - last) / np.maximum(1 - last, 1e-6)
    weight = excess.ravel() ** 2
    counts = (hits.image.ravel() != NONE) & (weight > 0)
    query, weight = query[counts], weight[counts]
    image, place = hits.image.ravel()[counts], hits.place.reshape(-1, 3)[counts]
    cell = _cells(landmarks)[query]
    weight /= np.sqrt(_cells_that_hit(image, place, cell))
    transforms = map_from_query(place, landmarks[query])
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2, 1.0])
    scale = place[:, 2] / landmarks.side[query]
    return Votes(image, transforms @ middle, scale, landmarks.angle[query], weight, cell)


def map_from_query(place: NDArray[np.floating], landmarks: Landmarks) -> NDArray[np.float64]:
    """Return (N, 2, 3) similarity transforms from windows of a query to windows of the map.

    Args:
        place: (N, 3) x and y of the centre, and side, of windows of the map, in pixels.
        landmarks: N windows of the query.
    """
    scale = place[:, 2] / landmarks.side
    cos, sin = scale * np.cos(landmarks.angle), scale * np.sin(landmarks.angle)
    linear = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    moved = place[:, :2] - np.einsum("nij,nj->ni", linear, landmarks.centre)
    return np.concatenate([linear, moved[:, :, np.newaxis]], axis=2)


def find_hypotheses(votes: Votes, size: tuple[int, int], most: int) -> list[Hypothesis]:
    """Return the transforms that most votes agree on, best first.

    Args:
        votes: votes of a query.
        size: width and height of the query, in pixels.
        most: largest number of hypotheses.
    """
    order = np.lexsort((-votes.weight, votes.cell, votes.image))
    votes = votes[order]
    starts = np.flatnonzero(np.diff(votes.image, prepend=NONE))
    if not len(starts):
        return []
    parts = np.split(np.arange(len(votes)), starts[1:])
    bound = np.add.reduceat(votes.weight, starts, dtype=np.float64)
    found: list[Hypothesis] = []
    for index in np.argsort(-bound, kind="stable"):
        if len(found) >= most and found[most - 1].votes >= bound[index]:
            break  # All votes for each of the remaining images are fewer.
        found.extend(_of_image(votes[parts[index]], size))
        found.sort(key=lambda each: -each.votes)
    return found[:most]


def _of_image(votes: Votes, size: tuple[int, int]) -> Iterator[Hypothesis]:
    """Yield the hypotheses in one image; a vote supports only the first that it agrees with.

    Args:
        votes: votes for the image, sorted by cell.
        size: width and height of the query, in pixels.
    """
    seeds = np.argsort(-votes.weight, kind="stable")[:SEEDS]
    agreeing = _agreeing(votes, seeds, math.hypot(*size))
    weight = votes.weight.copy()
    cells = np.flatnonzero(np.diff(votes.cell, prepend=-1))
    for _ in range(HYPOTHESES_PER_IMAGE):
        best_of_cells = np.maximum.reduceat(agreeing * weight, cells, axis=1)
        total = best_of_cells.sum(axis=1)
        best = int(total.argmax())
        if not total[best] > 0:
            return
        supporters = np.flatnonzero(agreeing[best] & (weight > 0))
        matrix = _mean_transform(votes[supporters], weight[supporters], size)
        yield Hypothesis(int(votes.image[0]), matrix, float(total[best]))
        weight[supporters] = 0


def _agreeing(votes: Votes, seeds: NDArray[np.intp], diagonal: float) -> Mask:
    """Return (S, N) which votes agree with each seed within the tolerances."""
    seed = votes[seeds]
    distance = np.hypot(*(votes.place - seed.place[:, np.newaxis]).transpose(2, 0, 1))
    near_by = distance < PLACE_TOLERANCE * diagonal * seed.scale[:, np.newaxis]
    ratio = np.abs(np.log(votes.scale) - np.log(seed.scale)[:, np.newaxis])
    turned = np.cos(votes.angle - seed.angle[:, np.newaxis])
    agree = near_by & (ratio < math.log(SCALE_TOLERANCE)) & (turned > math.cos(ANGLE_TOLERANCE))
    return np.asarray(agree)


def _mean_transform(votes: Votes, weight: NDArray[np.float64], size: tuple[int, int]) -> Matrix3:
    scale = math.exp(np.average(np.log(votes.scale), weights=weight))
    angle = math.atan2(np.sin(votes.angle) @ weight, np.cos(votes.angle) @ weight)
    x, y = np.average(votes.place, axis=0, weights=weight)
    cos, sin = scale * math.cos(angle), scale * math.sin(angle)
    across, down = (size[0] - 1) / 2, (size[1] - 1) / 2
    return np.array(
        [
            [cos, -sin, x - cos * across + sin * down],
            [sin, cos, y - sin * across - cos * down],
            [0, 0, 1],
        ]
    )


def _cells(landmarks: Landmarks) -> NDArray[np.intp]:
    """Return (N,) numbers of cells by position and size; windows half a side apart differ."""
    level = np.rint(2 * np.log2(landmarks.side))
    place = np.floor(landmarks.centre / (landmarks.side[:, np.newaxis] / 2))
    _, cell = np.unique(np.column_stack([level, place]), axis=0, return_inverse=True)
    return np.asarray(cell.ravel(), np.intp)


def _cells_that_hit(
    image: NDArray[np.int64], place: NDArray[np.float32], cell: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Return (N,) the number of query cells that hit the same map landmark as each hit."""
    order = np.lexsort((cell, *place.T, image))
    same_place = (np.diff(place[order], axis=0) == 0).all(axis=1)
    same = same_place & (np.diff(image[order]) == 0)
    landmark = np.concatenate([[0], np.cumsum(~same)])
    new_cell = np.concatenate([[True], ~(same & (np.diff(cell[order]) == 0))])
    found = np.empty(len(order), np.intp)
    found[order] = np.bincount(landmark, weights=new_cell).astype(np.intp)[landmark]
    return found
