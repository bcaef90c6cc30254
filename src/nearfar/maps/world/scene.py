"""Posed images of a map, and points of the scene that they and a query show."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, IndexPairs, Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics

ROTATION_ERROR = 1e-3
"""Largest difference of a rotation times its transpose from the identity."""
OBSERVED_WITHIN = 8.0
"""Largest distance, in pixels of a map image, from a match to the observed point that gives its
depth."""
SAME_POINT = 1.0
"""Largest distance, in pixels of the query, at which matches with two map images are one point."""


@dataclass(frozen=True, eq=False)
class PosedImage:
    """Camera and pose of a map image, and known points of the scene that it shows.

    Attributes:
        camera: intrinsics in pixels of the original image, without distortion.
        rotation: (3, 3) rotation from the camera to the world.
        centre: (3,) centre of the camera in the world.
        observed: (N, 2) pixels at which the image shows known points.
        points: (N, 3) these points in the world.
        world: name of the map source; images of the same world have the same frame. `Map.attach`
            sets it.
    """

    camera: CameraIntrinsics
    rotation: Matrix3
    centre: NDArray[np.float64]
    observed: Coordinates = field(default_factory=lambda: np.empty((0, 2)))
    points: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    world: str = ""

    @property
    def valid(self) -> bool:
        """Whether camera and pose are finite, the matrix is a rotation, and the shapes fit."""
        camera, rotation = self.camera, np.asarray(self.rotation)
        if rotation.shape != (3, 3) or np.shape(self.centre) != (3,):
            return False
        numbers = [camera.fx, camera.fy, camera.cx, camera.cy, *self.centre, *rotation.ravel()]
        if not np.isfinite(numbers).all() or len(self.observed) != len(self.points):
            return False
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        return bool(error < ROTATION_ERROR and np.linalg.det(rotation) > 0)

    def in_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 3) points of the world in the frame of the camera."""
        return np.asarray((points - self.centre) @ self.rotation)

    def in_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 3) points in the frame of the camera in the world."""
        return np.asarray(points @ self.rotation.T + self.centre)

    def errors(self, points: NDArray[np.float64], pixels: Coordinates) -> NDArray[np.float64]:
        """Return (N,) reprojection errors of (N, 3) points at (N, 2) pixels, in pixels.

        The error is infinite for points behind the camera.
        """
        seen = self.in_camera(points) @ self.camera.matrix.T
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.linalg.norm(seen[:, :2] / seen[:, 2:] - pixels, axis=1)
        return np.where(seen[:, 2] > 0, apart, np.inf)


@dataclass(frozen=True, eq=False)
class ImageMatches:
    """Matched points of a query and a map image with known camera and pose.

    Attributes:
        image: name of the map image.
        posed: camera and pose of the map image.
        seen: (N, 2) pixels of the map image.
        query: (N, 2) matched pixels of the query.
        pixel: size, in pixels of the query, of a pixel at which the matches were found.
        map_from_query: relative pose; None where a homography was estimated.
    """

    image: str
    posed: PosedImage
    seen: Coordinates
    query: Coordinates
    pixel: float
    map_from_query: RelativePose | None


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Points of the scene that a query shows.

    Attributes:
        query: (N, 2) pixels of the query.
        points: (N, 3) points in the world.
    """

    query: Coordinates
    points: NDArray[np.float64]

    @staticmethod
    def joined(parts: Sequence["ScenePoints"]) -> "ScenePoints":
        """Concatenate sets of points."""
        every = [ScenePoints(np.empty((0, 2)), np.empty((0, 3))), *parts]
        return ScenePoints(
            np.vstack([each.query for each in every]), np.vstack([each.points for each in every])
        )


def of_model(matches: Sequence[ImageMatches]) -> ScenePoints:
    """Place matched pixels of the map images at the depths of observed points near them."""
    return ScenePoints.joined([_near_observed(each) for each in matches])


def _near_observed(matches: ImageMatches) -> ScenePoints:
    """Place the matched pixels of an image at the depths of the nearest observed points.

    The ray of a pixel is that of the observed point beside it, so distortion hardly matters.
    """
    posed = matches.posed
    match, near = _pairs(matches.seen, posed.observed, OBSERVED_WITHIN, mutual=False).T
    known = posed.in_camera(posed.points[near])
    focal = [posed.camera.fx, posed.camera.fy]
    slope = known[:, :2] / known[:, 2:] + (matches.seen[match] - posed.observed[near]) / focal
    on_ray = known[:, 2:] * np.column_stack([slope, np.ones(len(slope))])
    return ScenePoints(matches.query[match], posed.in_world(on_ray))


def of_tracks(matches: Sequence[ImageMatches]) -> ScenePoints:
    """Triangulate the points of the query that two map images show."""
    parts = []
    for first, second in itertools.combinations(matches, 2):
        largest = SAME_POINT * max(first.pixel, second.pixel)
        in_first, in_second = _pairs(first.query, second.query, largest, mutual=True).T
        seen = first.seen[in_first], second.seen[in_second]
        points, good = triangulate(first.posed, second.posed, *seen)
        parts.append(ScenePoints(first.query[in_first][good], points[good]))
    return ScenePoints.joined(parts)


def _pairs(points: Coordinates, others: Coordinates, largest: float, *, mutual: bool) -> IndexPairs:
    """Return (M, 2) indices of points and their nearest others within the `largest` distance."""
    if not len(points) or not len(others):
        return np.empty((0, 2), np.intp)
    matcher = cv2.BFMatcher(cv2.NORM_L2, crossCheck=mutual)
    found = matcher.match(points.astype(np.float32), others.astype(np.float32))
    near = [(each.queryIdx, each.trainIdx) for each in found if each.distance <= largest]
    return np.array(near, np.intp).reshape(-1, 2)


LEAST_ANGLE = 1.0
"""Least angle in degrees between the two rays to a point; below it the depth is too uncertain."""
LARGEST_ERROR = 3.0
"""Largest reprojection error of a triangulated point, in pixels of each image."""


def triangulate(
    first: PosedImage, second: PosedImage, seen_first: Coordinates, seen_second: Coordinates
) -> tuple[NDArray[np.float64], Mask]:
    """Triangulate points from the pixels at which two images show them.

    Args:
        first: an image.
        second: another image of the same world.
        seen_first: (N, 2) pixels of the first image.
        seen_second: (N, 2) pixels of the second image.

    Returns:
        (N, 3) points in the world, and (N,) which of them are valid: in front of both cameras, with
        small errors in both images and a wide enough angle between the rays.
    """
    if not len(seen_first):
        return np.empty((0, 3)), np.empty(0, np.bool_)
    origin = first.centre
    projections = [_projection(posed, origin) for posed in (first, second)]
    seen = [np.ascontiguousarray(each.T, np.float64) for each in (seen_first, seen_second)]
    homogeneous = cv2.triangulatePoints(*projections, *seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = (homogeneous[:3] / homogeneous[3]).T + origin
    good = np.isfinite(points).all(axis=1)
    points[~good] = origin
    for posed, pixels in ((first, seen_first), (second, seen_second)):
        good &= posed.errors(points, pixels) < LARGEST_ERROR
    good &= _angles(points - first.centre, points - second.centre) >= LEAST_ANGLE
    return points, good


def meeting_point(
    origins: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (3,) the point nearest to rays, by least squares.

    Args:
        origins: (N, 3) origins of the rays.
        directions: (N, 3) unit vectors, not all parallel.
    """
    across = np.eye(3) - directions[:, :, np.newaxis] * directions[:, np.newaxis, :]
    rows, targets = across.reshape(-1, 3), np.einsum("nij,nj->ni", across, origins).ravel()
    return np.asarray(np.linalg.lstsq(rows, targets)[0])


def _projection(posed: PosedImage, origin: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 4) projection from a world that is moved so that numbers stay small."""
    moved = -posed.rotation.T @ (posed.centre - origin)
    return np.asarray(posed.camera.matrix @ np.column_stack([posed.rotation.T, moved]))


def _angles(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N,) angles between (N, 3) vectors, in degrees."""
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, (first * second).sum(axis=1))))
