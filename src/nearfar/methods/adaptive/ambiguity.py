"""Ambiguity: other places of the far image that the near image fits nearly as well.

Equal windows, arches, bricks or several copies of one object give several homographies of the same
quality. The near image is reduced to the scale of the far one. Each of its keypoints votes with all
far keypoints that are similar to it, not with the nearest one alone, so that equal places get equal
votes.
"""

from dataclasses import replace

import numpy as np

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.constants import AmbiguityConstants, VoteConstants
from nearfar.features.detection import detect_rootsift
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import negative_squared_distance
from nearfar.geometry.homography import local_scale, outline, transform
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized
from nearfar.methods.adaptive.pair import AdaptiveFeatures
from nearfar.methods.adaptive.votes import Tentative, hypotheses, matches_of
from nearfar.methods.adaptive.zoom import inside
from nearfar.models import Alternative
from nearfar.verification.correlation import correlated


def alternatives(
    far: AdaptiveFeatures,
    near: AdaptiveFeatures,
    far_from_near: Matrix3,
    constants: AmbiguityConstants,
    votes: VoteConstants,
) -> tuple[Alternative, ...]:
    """Return other places that explain the near image nearly as well as a homography.

    Args:
        far: features of the far image.
        near: features of the near image.
        far_from_near: the homography.
        constants: of the comparison.
        votes: constants of the votes.
    """
    width, height = near.size
    middle = np.array([width - 1, height - 1]) / 2
    factor = local_scale(far_from_near, middle)
    if factor > constants.least_factor:
        best = np.argsort(-near.keypoints.score, kind="stable")[: constants.most_points]
        points = near.keypoints[best]
    else:
        points = _reduced_keypoints(near.image, factor, constants)
    matches = _similar(far.keypoints, points, constants)
    agreeing = _agrees(matches, far_from_near, votes)
    own, elsewhere = _count(matches.near[agreeing]), matches[~agreeing]
    least = constants.least_score * own
    if own < constants.least_own:
        return tuple(correlated(far.image, near.image, far_from_near, constants))
    if _count(elsewhere.near) < least:
        return ()
    corners = outline(width, height)
    centre = transform(far_from_near, middle[np.newaxis])[0]
    diagonal = float(np.linalg.norm(np.ptp(transform(far_from_near, corners), axis=0)))
    voters = replace(elsewhere, constants=replace(votes, seeds=constants.seeds))
    found: list[tuple[Coordinates, Alternative]] = []
    for each in hypotheses(voters, constants.most, "votes"):
        at = transform(each.far_from_near, middle[np.newaxis])[0]
        agreeing = _agrees(matches, each.far_from_near, votes)
        count = _count(matches.near[agreeing])
        if count >= least:
            found.append((at, Alternative(each.far_from_near, min(1.0, count / own))))
    return _distinct(found, centre, constants.least_distance * diagonal)


def _distinct(
    found: list[tuple[Coordinates, Alternative]], centre: Coordinates, apart: float
) -> tuple[Alternative, ...]:
    """Return the alternatives at different places, best first.

    Args:
        found: (2,) far point of the near image's middle, and the alternative.
        centre: (2,) the same point of the answer.
        apart: least distance of two places, in far pixels.
    """
    taken, kept = [centre], []
    for at, alternative in sorted(found, key=lambda each: -each[1].score):
        if min(np.linalg.norm(at - other) for other in taken) > apart:
            taken.append(at)
            kept.append(alternative)
    return tuple(kept)


def _reduced_keypoints(
    near: MaskedImage, factor: float, constants: AmbiguityConstants
) -> Keypoints:
    """Detect keypoints of the near image at the scale of the far one, in near pixels."""
    small, small_from_near = resized(near.pixels, factor)
    points = detect_rootsift(small, constants.contrast, constants.most_points)
    points = inside(points, small_from_near, near)
    return replace(points, xy=transform(np.linalg.inv(small_from_near), points.xy))


def _similar(far: Keypoints, near: Keypoints, constants: AmbiguityConstants) -> Tentative:
    """Match each near keypoint with its nearest neighbours among the far ones, if similar."""
    if not len(far) or not len(near):
        return matches_of(far, near, np.empty((0, 2), np.intp), np.empty(0))
    similarity = negative_squared_distance(near.descriptors, far.descriptors)
    count = min(constants.neighbours, len(far))
    nearest = np.argpartition(-similarity, count - 1, axis=1)[:, :count]
    distance = -np.take_along_axis(similarity, nearest, axis=1)
    rows, columns = np.nonzero(distance < constants.most_distance)
    pairs = np.column_stack([nearest[rows, columns], rows])
    weight = 1 - distance[rows, columns].astype(np.float64)
    return matches_of(far, near, pairs, weight)


def _agrees(matches: Tentative, far_from_near: Matrix3, votes: VoteConstants) -> Mask:
    """Return which of N matches lie where a transform puts their near point."""
    errors = np.linalg.norm(transform(far_from_near, matches.near) - matches.far, axis=1)
    return np.asarray(errors < votes.least_tolerance)


def _count(near: Coordinates) -> int:
    """Return the number of different points among (N, 2) ones."""
    return len(np.unique(near, axis=0))
