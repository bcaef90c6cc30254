"""Hypotheses of where the near image lies: similarity transforms that many matches agree on.

Each match of two keypoints tells a place, a scale and a rotation (Lowe, 2004). Wrong matches tell
something else each time, so that a handful of agreeing ones stands out even where most are wrong.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, IndexPairs, Mask
from nearfar.constants import DEFAULT, VoteConstants
from nearfar.features.keypoints import Keypoints
from nearfar.features.matching import first_of_each_cell
from nearfar.features.nearest import Nearest
from nearfar.methods.adaptive.hypothesis import Hypothesis


@dataclass(frozen=True, eq=False)
class Tentative:
    """Matches of which most may be wrong, with the similarity transform that each tells.

    Attributes:
        far: (N, 2) far points.
        near: (N, 2) near points.
        scale: (N,) size of the far over that of the near keypoint.
        angle: (N,) orientation of the far minus that of the near keypoint, radians.
        weight: (N,) 0 to 1, how distinctive.
        constants: of the votes.
    """

    far: Coordinates
    near: Coordinates
    scale: NDArray[np.float64]
    angle: NDArray[np.float64]
    weight: NDArray[np.float64]
    constants: VoteConstants = DEFAULT.votes

    def __len__(self) -> int:
        return len(self.weight)

    def __getitem__(self, chosen: Mask) -> "Tentative":
        return Tentative(
            self.far[chosen],
            self.near[chosen],
            self.scale[chosen],
            self.angle[chosen],
            self.weight[chosen],
            self.constants,
        )

    def agreeing(self, seed: int) -> Mask:
        """Return the (N,) mask of matches whose transform is nearly that of one of them."""
        away_near = self.near - self.near[seed]
        cos = self.scale[seed] * np.cos(self.angle[seed])
        sin = self.scale[seed] * np.sin(self.angle[seed])
        away_far = away_near @ np.array([[cos, sin], [-sin, cos]])
        apart = np.hypot(*(self.far - self.far[seed] - away_far).T)
        tolerance = self.constants.least_tolerance + self.constants.distance_tolerance * np.hypot(
            *away_far.T
        )
        scaled = np.abs(np.log(self.scale / self.scale[seed])) < np.log(
            self.constants.scale_tolerance
        )
        turned = np.cos(self.angle - self.angle[seed]) > np.cos(
            np.radians(self.constants.angle_tolerance)
        )
        return np.asarray((apart < tolerance) & scaled & turned)


def tentative_matches(
    far: Keypoints,
    near: Keypoints,
    of_far: Nearest,
    of_near: Nearest,
    constants: VoteConstants = DEFAULT.votes,
) -> Tentative:
    """Return the most distinctive nearest neighbours of both directions.

    Args:
        far: keypoints of the far image.
        near: keypoints of the near image.
        of_far: nearest near keypoint of each far one.
        of_near: nearest far keypoint of each near one.
        constants: of the votes.
    """
    pairs, weights = [], []
    for side, found in enumerate((of_far, of_near)):
        own = np.flatnonzero(found.index >= 0)
        both = [own, found.index[own]]
        pairs.append(np.column_stack(both[::-1] if side else both))
        ratio = found.distance[own] / np.maximum(found.second[own], 1e-9)
        weights.append(1 - np.minimum(ratio, 1).astype(np.float64))
    every, weight = np.vstack(pairs), np.concatenate(weights)
    best = np.argsort(-weight, kind="stable")[: constants.most_matches]
    best = best[weight[best] > constants.least_weight]
    distinct, first = np.unique(every[best], axis=0, return_index=True)
    return replace(matches_of(far, near, distinct, weight[best][first]), constants=constants)


def matches_of(
    far: Keypoints, near: Keypoints, pairs: IndexPairs, weight: NDArray[np.float64]
) -> Tentative:
    """Return (M, 2) pairs of keypoints as matches with their similarity transforms."""
    i, j = pairs.T
    scale, angle = far.scale[i] / near.scale[j], far.angle[i] - near.angle[j]
    return Tentative(far.xy[i], near.xy[j], scale, angle, weight)


def hypotheses(matches: Tentative, most: int, source: str) -> list[Hypothesis]:
    """Return the transforms with most support, best first; each match supports only one.

    Args:
        matches: the matches.
        most: how many.
        source: what to call where they come from.
    """
    constants = matches.constants
    seeds = np.argsort(-matches.weight, kind="stable")[: constants.seeds]
    agreeing = np.array([matches.agreeing(seed) for seed in seeds], np.bool_)
    weight = matches.weight.copy()
    found: list[Hypothesis] = []
    for _ in range(len(seeds)):
        if len(found) == most:
            break
        best = int((agreeing @ weight).argmax())
        supporters = np.flatnonzero(agreeing[best] & (weight > 0))
        supporters = supporters[np.argsort(-weight[supporters], kind="stable")]
        places = matches.far[supporters], matches.near[supporters]
        supporters = supporters[first_of_each_cell(*places, constants.cell)]
        weight[agreeing[best]] = 0
        if len(supporters) == 0:
            break
        if len(supporters) < constants.least_supporters:
            continue
        similarity, _ = cv2.estimateAffinePartial2D(
            matches.near[supporters],
            matches.far[supporters],
            method=cv2.RANSAC,
            ransacReprojThreshold=constants.least_tolerance,
        )
        if similarity is not None and np.isfinite(similarity).all():
            support = float(matches.weight[supporters].sum())
            found.append(Hypothesis(np.vstack([similarity, [0, 0, 1]]), support, source))
    return sorted(found, key=lambda each: -each.support)


def local_support(matches: Tentative) -> NDArray[np.float64]:
    """Return the (N,) sums of weights of all agreeing matches in each one's neighbourhood.

    In a scene with depth no transform holds everywhere, but nearly the same one holds for
    neighbours.
    """
    support = np.empty(len(matches))
    for seed in range(len(matches)):
        near_by = np.hypot(*(matches.near - matches.near[seed]).T) < matches.constants.neighbourhood
        support[seed] = matches.weight[near_by & matches.agreeing(seed)].sum()
    return support
