"""The pose of a query in the world, from its matches with map images of known camera and pose."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import poselib
from numpy.typing import NDArray

from nearfar.arrays import Mask, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.maps.answers import MapAnswer
from nearfar.maps.tables import MapImage
from nearfar.maps.world.places import QueryPose, Source
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.scene import (
    ImageMatches,
    PosedImage,
    ScenePoints,
    meeting_point,
    of_model,
    of_tracks,
)

VIEWS = 3
"""Map images that are sought for a pose: it takes two to triangulate."""


@dataclass(frozen=True, eq=False)
class Posing:
    """The cameras of a query and of the map images that it may lie in.

    Attributes:
        camera: of the query, in its pixels.
        posed: map images whose camera and pose are known, by name.
    """

    camera: CameraIntrinsics
    posed: dict[str, PosedImage]

    @staticmethod
    def of(
        store: PoseStore, images: Iterable[MapImage], camera: CameraIntrinsics | None
    ) -> "Posing | None":
        """What is known; None where the query's camera, or that of all the images, is not."""
        if camera is None:
            return None
        names = {image.id: image.name for image in images}
        posed = {names[key]: each for key, each in store.get(list(names)).items()}
        return Posing(camera, posed) if posed else None

    def cameras(self, image: str) -> Intrinsics | None:
        """Of a map image (far) and the query (near); None where that of the image is not known."""
        posed = self.posed.get(image)
        return None if posed is None else Intrinsics(posed.camera, self.camera)

    def apart(self, image: str, other: str) -> float:
        """Distance between the cameras of two map images; infinite where it is not known."""
        first, second = self.posed.get(image), self.posed.get(other)
        if first is None or second is None or first.world != second.world:
            return math.inf
        return float(np.linalg.norm(first.centre - second.centre))

    def query_pose(self, answers: Sequence[MapAnswer], seed: int) -> QueryPose | None:
        """The pose of the query.

        Args:
            answers: best first.
            seed: of every random choice.
        """
        matches = [
            _matches(answer, self.posed[answer.image])
            for answer in answers
            if answer.image in self.posed
        ]
        return query_pose(matches, self.camera, seed)


def _matches(answer: MapAnswer, posed: PosedImage) -> ImageMatches:
    points, found = answer.points, answer.localization
    working = found.near.width / found.near.working_size[0]
    model = answer.far_from_near
    return ImageMatches(
        answer.image,
        posed,
        points.far[points.inliers],
        points.near[points.inliers],
        max(working, found.scale_change or 0.0),
        model if isinstance(model, RelativePose) else None,
    )


LARGEST_ERROR = 3.0
"""Of a point of the scene in the query, in pixels at which the matches were found."""
LEAST_INLIERS = 12
LEAST_ANGLE = 5.0
"""Between the directions from two map images, in degrees, so that they meet at a place."""
ITERATIONS = 10_000


def query_pose(
    matches: Sequence[ImageMatches], camera: CameraIntrinsics, seed: int
) -> QueryPose | None:
    """The pose of a query.

    Args:
        matches: with map images, the best first; only those of its world are used.
        camera: of the query, in its pixels.
        seed: of every random choice.

    Returns:
        The pose; None where there are no matches, or neither pose nor direction can be told.
    """
    same = [each for each in matches if each.posed.world == matches[0].posed.world]
    if not same:
        return None
    source: Source = "model" if any(len(each.posed.points) for each in same) else "triangulation"
    scene = of_model(same) if source == "model" else of_tracks(same)
    pixel = float(np.median([each.pixel for each in same]))
    found = _absolute(scene, camera, LARGEST_ERROR * pixel, seed)
    if found is None:
        return _by_directions(same)
    rotation, centre, inliers = found
    return QueryPose(
        same[0].posed.world,
        rotation,
        centre,
        None,
        source,
        int(inliers.sum()),
        tuple(each.image for each in same),
    )


def _absolute(
    scene: ScenePoints, camera: CameraIntrinsics, largest_error: float, seed: int
) -> tuple[Matrix3, NDArray[np.float64], Mask] | None:
    """Rotation and centre of the query's camera in the world, and the points that agree."""
    if len(scene.points) < LEAST_INLIERS:
        return None
    pinhole = {
        "model": "PINHOLE",
        "width": 0,
        "height": 0,
        "params": [camera.fx, camera.fy, camera.cx, camera.cy],
    }
    options: dict[str, Any] = {
        "max_reproj_error": largest_error,
        "max_iterations": ITERATIONS,
        "seed": seed,
    }
    origin = np.median(scene.points, axis=0)
    pose, info = poselib.estimate_absolute_pose(
        scene.query, scene.points - origin, pinhole, options
    )
    inliers = np.asarray(info["inliers"], np.bool_)
    rotation = np.asarray(pose.R).T
    centre = origin - rotation @ np.asarray(pose.t)
    if inliers.sum() < LEAST_INLIERS or not np.isfinite(centre).all():
        return None
    return rotation, centre, inliers


def _by_directions(matches: Sequence[ImageMatches]) -> QueryPose | None:
    """Where the directions from several map images meet, or the direction from the best alone."""
    directed = [(each, each.map_from_query) for each in matches if each.map_from_query]
    if not directed:
        return None
    best, pose = directed[0]
    directions = np.array(
        [each.posed.rotation @ relative.translation for each, relative in directed]
    )
    origins = np.array([each.posed.centre for each, _ in directed])
    place = _meeting_place(origins, directions)
    used = directed[:1] if place is None else directed
    return QueryPose(
        best.posed.world,
        best.posed.rotation @ pose.rotation,
        place,
        directions[0] if place is None else None,
        "one image" if place is None else "directions",
        sum(len(each.seen) for each, _ in used),
        tuple(each.image for each, _ in used),
    )


def _meeting_place(
    origins: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Where rays meet; None where they are nearly parallel, or meet behind where they start."""
    cosines = directions @ directions.T
    if np.abs(cosines).min() > np.cos(np.radians(LEAST_ANGLE)):
        return None
    place = meeting_point(origins, directions)
    return place if (((place - origins) * directions).sum(axis=1) > 0).all() else None
