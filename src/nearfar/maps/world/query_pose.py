"""Estimate the pose of a query in the world from matches with map images of known pose."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.maps.answers import MapAnswer
from nearfar.maps.tables import MapImage
from nearfar.maps.world.absolute_pose import absolute_pose
from nearfar.maps.world.places import QueryPose, Source
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.scene import (
    ImageMatches,
    PosedImage,
    meeting_point,
    of_model,
    of_tracks,
)

VIEWS = 3
"""Number of map images to seek for a pose; triangulation needs two."""


@dataclass(frozen=True, eq=False)
class Posing:
    """The cameras of a query and of the map images that it may lie in.

    Attributes:
        camera: camera of the query, in its pixels.
        posed: map images whose camera and pose are known, by name.
    """

    camera: CameraIntrinsics
    posed: dict[str, PosedImage]

    @staticmethod
    def of(
        store: PoseStore, images: Iterable[MapImage], camera: CameraIntrinsics | None
    ) -> "Posing | None":
        """Return what is known; None without the query's camera or any map image's pose."""
        if camera is None:
            return None
        names = {image.id: image.name for image in images}
        posed = {names[key]: each for key, each in store.get(list(names)).items()}
        return Posing(camera, posed) if posed else None

    def cameras(self, image: str) -> Intrinsics | None:
        """Return the cameras of a map image (far) and the query (near); None without the former."""
        posed = self.posed.get(image)
        return None if posed is None else Intrinsics(posed.camera, self.camera)

    def distance(self, image: str, other: str) -> float:
        """Return the distance between the cameras of two map images; infinite where unknown."""
        first, second = self.posed.get(image), self.posed.get(other)
        if first is None or second is None or first.world != second.world:
            return math.inf
        return float(np.linalg.norm(first.centre - second.centre))

    def query_pose(self, answers: Sequence[MapAnswer], seed: int) -> QueryPose | None:
        """Estimate the pose of the query.

        Args:
            answers: best first.
            seed: seed of every random choice.
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
"""Largest reprojection error of an inlier, in pixels of the image at which matches were found."""
LEAST_ANGLE = 5.0
"""Least angle in degrees between the directions from two map images that are intersected."""


def query_pose(
    matches: Sequence[ImageMatches], camera: CameraIntrinsics, seed: int
) -> QueryPose | None:
    """Estimate the pose of a query.

    Args:
        matches: matches with map images, the best first; only images of its world are used.
        camera: camera of the query, in its pixels.
        seed: seed of every random choice.

    Returns:
        The pose; None where there are no matches, or they give neither pose nor direction.
    """
    same = [each for each in matches if each.posed.world == matches[0].posed.world]
    if not same:
        return None
    source: Source = "model" if any(len(each.posed.points) for each in same) else "triangulation"
    scene = of_model(same) if source == "model" else of_tracks(same)
    pixel = float(np.median([each.pixel for each in same]))
    found = absolute_pose(scene, camera, pixel, LARGEST_ERROR, seed)
    if found is None:
        return _by_directions(same)
    return QueryPose(
        same[0].posed.world,
        found.rotation,
        found.centre,
        None,
        source,
        int(found.inliers.sum()),
        tuple(each.image for each in same),
        found.covariance,
    )


def _by_directions(matches: Sequence[ImageMatches]) -> QueryPose | None:
    """Intersect the directions from several map images, or return that from the best alone."""
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
    """Intersect rays; return None where they are nearly parallel or meet behind their origins."""
    cosines = directions @ directions.T
    if np.abs(cosines).min() > np.cos(np.radians(LEAST_ANGLE)):
        return None
    place = meeting_point(origins, directions)
    return place if (((place - origins) * directions).sum(axis=1) > 0).all() else None
