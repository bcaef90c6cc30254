"""Match a frame with the points of the scene that a map shows, and solve for its pose."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import IndexPairs, Matrix3
from nearfar.features.detection import detect_rootsift
from nearfar.features.guided import Gate, nearest_within
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import mutual_by_ratio, nearest_neighbours
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized
from nearfar.maps.world.absolute_pose import AbsolutePose, absolute_pose
from nearfar.maps.world.scene import ImageMatches, ScenePoints, of_tracks
from nearfar.methods.adaptive.zoom import inside
from nearfar.tracking.mapped_points import MappedImage, MappedPoints
from nearfar.tracking.mapped_points import nearest_within as nearest_places
from nearfar.verification.confidence import confidence
from nearfar.verification.expected_error import ExpectedError
from nearfar.verification.significance import log10_nfa

Array = NDArray[np.float64]

EQUAL = 0.01
"""Distance in pixels at which a place is a keypoint's own."""
NO_INDICES = np.empty(0, np.intp)


@dataclass(frozen=True, kw_only=True)
class PoseMatchConstants:
    """Matching of a frame with points of the scene; lengths are shares of the frame's diagonal."""

    sides: tuple[int, ...] = (640, 1280)
    """Longest sides of the reduced frames in which keypoints are detected, in pixels: SIFT takes
    most of the time, so that the larger one is only tried where the smaller one gives too few."""
    points: int = 1500
    """Most keypoints of a frame, those of the highest contrast."""
    contrast: float = 0.02
    """SIFT's contrast threshold."""
    ratio: float = 0.9
    """Ratio test among the keypoints within reach..."""
    wide_ratio: float = 0.85
    """...and over the whole frame."""
    size_tolerance: float = 2.0
    """Factor by which the sizes of matched keypoints may differ."""
    angle_tolerance: float = 40.0
    """Angle by which their orientations may differ, in degrees."""
    least_reach: float = 0.04
    """Least distance of a match from its expected position."""
    most_reach: float = 0.15
    """Largest one at the predicted pose."""
    deviations: float = 3.0
    """Standard deviations of the prediction within which a match may lie."""
    largest_error: float = 2.0
    """Largest reprojection error of an inlier, in pixels of the reduced frame."""
    enough: int = 16
    """Inliers from which no more keypoints are detected."""
    cell: float = 64.0
    """Side of the grid cells in which keypoints are compared, in pixels."""


class PoseFrame:
    """A frame as a pinhole camera would have taken it.

    Args:
        image: pixels and mask.
        camera: the camera.
        constants: of the keypoints.
    """

    def __init__(
        self, image: MaskedImage, camera: CameraIntrinsics, constants: PoseMatchConstants
    ) -> None:
        self.image, self.camera, self.constants = image, camera, constants
        self._points: dict[float, Keypoints] = {}

    @property
    def focal(self) -> float:
        """Return the focal length in pixels."""
        return (self.camera.fx + self.camera.fy) / 2

    @property
    def diagonal(self) -> float:
        """Return the length of the diagonal in pixels."""
        return math.hypot(*self.image.size)

    @property
    def scales(self) -> list[float]:
        """Return the pixels of the frame that a pixel of each reduced frame is large."""
        longest = max(self.image.size)
        return sorted({max(1.0, longest / side) for side in self.constants.sides}, reverse=True)

    def points(self, scale: float) -> Keypoints:
        """Return keypoints of a reduced frame, in pixels of the frame.

        Args:
            scale: one of `scales`.
        """
        if scale not in self._points:
            small, small_from_frame = resized(self.image.pixels, 1 / scale)
            found = detect_rootsift(small, self.constants.contrast, self.constants.points)
            found = inside(found, small_from_frame, self.image)
            own = transform(np.linalg.inv(small_from_frame), found.xy)
            self._points[scale] = replace(found, xy=own, scale=found.scale * scale)
        return self._points[scale]


@dataclass(frozen=True, eq=False)
class PredictedPose:
    """Where a camera is expected.

    Attributes:
        rotation: (3, 3) takes directions in the camera to the world.
        centre: (3,) its centre.
        spread: standard deviation of the centre along its worst direction.
        turned: standard deviation of the rotation, in radians.
    """

    rotation: Matrix3
    centre: Array
    spread: float
    turned: float


@dataclass(frozen=True, eq=False)
class MeasuredPose:
    """A pose that matches give.

    Attributes:
        pose: the pose.
        images: names of the images whose points agree, that of most points first.
        confidence: probability that the pose is right and exact.
        seen: the points that agree, with the keypoints of the frame.
    """

    pose: AbsolutePose
    images: tuple[str, ...]
    confidence: float
    seen: MappedPoints


@dataclass(frozen=True, eq=False)
class SceneMatches:
    """M matches of a frame with points of the scene.

    Attributes:
        near: (M,) indices of keypoints of the frame.
        points: (M, 3) in the world.
        images: (M,) names of the map images that show the points.
    """

    near: NDArray[np.intp]
    points: Array
    images: NDArray[np.object_]


Matching = Callable[[float], SceneMatches]
"""Matches the keypoints of the reduced frame of a scale."""


def measured(frame: PoseFrame, matching: Matching, seed: int) -> MeasuredPose | None:
    """Return the pose that most matches agree with; None where too few agree.

    Args:
        frame: the frame.
        matching: matches it with points of the scene.
        seed: seed of every random choice.
    """
    best: MeasuredPose | None = None
    for scale in frame.scales:
        found = _solved(frame, scale, matching(scale), seed)
        if found is not None and (best is None or len(found.seen) > len(best.seen)):
            best = found
        if best is not None and len(best.seen) >= frame.constants.enough:
            break
    return best


def by_tracks(frame: PoseFrame, images: Sequence[MappedImage], scale: float) -> SceneMatches:
    """Triangulate the keypoints of a frame that match in two map images.

    Points that the nearest map images show are placed relative to their poses, which fit each other
    better than those of images that are far apart.
    """
    keypoints, matches = frame.points(scale), []
    for each in images:
        nearest = nearest_neighbours(each.keypoints, keypoints)
        far, near = mutual_by_ratio(*nearest, frame.constants.wide_ratio).T
        seen = each.keypoints.xy[far], keypoints.xy[near]
        matches.append(ImageMatches(each.name, each.posed, *seen, scale, None))
    scene = of_tracks(matches)
    which, near = nearest_places(scene.query, keypoints.xy, EQUAL)
    names = np.array([each.name for each in images][:1] * len(which), object)
    return SceneMatches(near, scene.points[which], names)


def by_points(
    frame: PoseFrame, parts: Sequence[MappedPoints], expected: PredictedPose | None, scale: float
) -> SceneMatches:
    """Match known points of the scene where the expected pose shows them; anywhere without one."""
    keypoints = frame.points(scale)
    pairs = [
        mutual_by_ratio(*nearest_neighbours(part.keypoints, keypoints), frame.constants.wide_ratio)
        if expected is None
        else _within(part, keypoints, frame, expected)
        for part in parts
    ]
    shown = [part.points[each[:, 0]] for part, each in zip(parts, pairs, strict=True)]
    names = np.array([part.image for part in parts], object)
    return SceneMatches(
        np.concatenate([NO_INDICES, *(each[:, 1] for each in pairs)]),
        np.vstack([np.empty((0, 3)), *shown]),
        np.repeat(names, [len(each) for each in pairs]),
    )


def _solved(
    frame: PoseFrame, scale: float, matches: SceneMatches, seed: int
) -> MeasuredPose | None:
    keypoints, limit = frame.points(scale), frame.constants.largest_error
    scene = ScenePoints(keypoints.xy[matches.near], matches.points)
    pose = absolute_pose(scene, frame.camera, scale, limit, seed)
    if pose is None:
        return None
    agreed = pose.inliers
    counted = Counter(matches.images[agreed])
    names = tuple(str(name) for name, _ in counted.most_common())
    # A keypoint may match the same point in several map images: equal ones fail the ratio test.
    distinct, first = np.unique(matches.near[agreed], return_index=True)
    seen = MappedPoints(
        keypoints[distinct], matches.points[agreed][first], pose.centre, frame.focal, names[0]
    )
    return MeasuredPose(pose, names, _confidence(frame, scene, pose, limit * scale), seen)


def _within(
    part: MappedPoints, keypoints: Keypoints, frame: PoseFrame, expected: PredictedPose
) -> IndexPairs:
    """Match the points where the expected pose shows them, at the size that they have there."""
    limits = frame.constants
    seen = (part.points - expected.centre) @ expected.rotation
    depth = seen[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = seen @ frame.camera.matrix.T
        xy = xy[:, :2] / xy[:, 2:]
    reach = _reach(frame, expected, depth)
    shown = (depth > 0) & (xy > -reach).all(axis=1)
    shown &= (xy < np.array(frame.image.size) + reach).all(axis=1)
    index = np.flatnonzero(shown)
    if not len(index):
        return np.empty((0, 2), np.intp)
    away = np.linalg.norm(part.points[index] - part.centre, axis=1)
    nearer = away / np.linalg.norm(part.points[index] - expected.centre, axis=1)
    focal = frame.focal / part.focal
    there = replace(
        part.keypoints[index],
        xy=xy[index],
        scale=np.maximum(part.keypoints.scale[index] * nearer * focal, 1e-6),
    )
    gate = Gate(reach, limits.size_tolerance, math.radians(limits.angle_tolerance))
    found = mutual_by_ratio(*nearest_within(there, keypoints, gate, limits.cell), limits.ratio)
    return np.column_stack([index[found[:, 0]], found[:, 1]])


def _reach(frame: PoseFrame, expected: PredictedPose, depth: Array) -> float:
    """Return how far from their expected positions points may be seen, in pixels."""
    limits = frame.constants
    ahead = depth[depth > 0]
    typical = float(np.median(ahead)) if len(ahead) else math.inf
    spread = math.hypot(expected.spread / typical, expected.turned)
    share = limits.deviations * spread * frame.focal / frame.diagonal
    return frame.diagonal * min(max(share, limits.least_reach), limits.most_reach)


def _confidence(
    frame: PoseFrame, scene: ScenePoints, pose: AbsolutePose, threshold: float
) -> float:
    """Return the probability of a pose, as of one between two images.

    The error of the centre counts as an angle: seen from the median point.
    """
    agreed = pose.inliers
    width, height = frame.image.size
    chance = log10_nfa(
        "homography",
        scene.query[agreed],
        scene.query[agreed],
        len(scene.points),
        threshold=threshold,
        far_size=(width, height),
    )
    depth = float(np.median(np.linalg.norm(scene.points[agreed] - pose.centre, axis=1)))
    variances = np.diag(pose.covariance)
    turned = math.degrees(math.sqrt(variances[:3].sum()))
    off = math.degrees(math.atan2(math.sqrt(variances[3:].sum()), depth))
    return confidence("pose", chance, ExpectedError(rotation=turned, direction=off))
