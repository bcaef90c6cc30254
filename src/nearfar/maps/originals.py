"""Answers of a map in pixels of the original query, and their places on the Earth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized, transform
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.undistorted import View as LensView
from nearfar.localization import PointMatches
from nearfar.maps.answers import MapAnswer, VerifiedCandidate
from nearfar.maps.world.photo_position import PhotoPosition
from nearfar.maps.world.photograph_ground import fitted_ground, ground_of_drone
from nearfar.maps.world.places import GeoPlace, GeoSource, geo_place, geo_place_in
from nearfar.undistortion import outline_in_far


@dataclass(frozen=True)
class MapPhotograph:
    """A map image as a photograph of a place.

    Attributes:
        file: its file on a disk.
        width: as displayed, in pixels.
        height: as displayed, in pixels.
        position: where it was taken.
    """

    file: Path
    width: int
    height: int
    position: PhotoPosition

    @property
    def middle(self) -> tuple[float, float]:
        """The pixel in its middle."""
        return (self.width - 1) / 2, (self.height - 1) / 2


def on_earth(
    answers: Sequence[MapAnswer], view: LensView, photographs: Mapping[str, MapPhotograph]
) -> tuple[MapAnswer, ...]:
    """Return answers for the original query, with its place on the Earth by each.

    A georeferenced map image names the place itself. Of photographs, the GPS position, the height
    and the direction of one name it, or else the GPS positions of several.

    Args:
        answers: answers for the query without distortion, best first.
        view: the query.
        photographs: their map images, by name.
    """
    found = [with_distortion(answer, view) for answer in answers]
    return tuple(_with_place(each, found, view, photographs) for each in found)


def _with_place(
    answer: MapAnswer,
    answers: Sequence[MapAnswer],
    view: LensView,
    photographs: Mapping[str, MapPhotograph],
) -> MapAnswer:
    """Return an answer with the place of the query, and that of the camera of its map image."""
    photograph, model = photographs[answer.image], answer.far_from_near
    taken = photograph.position if photograph.position.known else None
    if isinstance(model, RelativePose):
        return replace(answer, taken=taken)
    known = Intrinsics(None, view.camera)
    place = geo_place(photograph.file, model, view.size, known, answer.expected_error)
    if place is None and taken is not None:
        place = _by_photographs(answer, model, answers, view, photographs)
    return replace(answer, world=place, taken=taken)


def _by_photographs(
    answer: MapAnswer,
    model: Matrix3,
    answers: Sequence[MapAnswer],
    view: LensView,
    photographs: Mapping[str, MapPhotograph],
) -> GeoPlace | None:
    """Return the place of the query by the GPS positions of map images; None where it is open."""
    own = photographs[answer.image]
    source: GeoSource = "drone"
    ground = ground_of_drone(own.position, own.width, own.height)
    if ground is None:
        source = "photographs"
        middles, positions = [], []
        for name, query_from_far in _of_images(answers).items():
            other = photographs[name]
            if other.position.known:
                far_from_other = model @ query_from_far
                middles.append(transform(far_from_other, np.array([other.middle]))[0])
                positions.append(other.position)
        ground = fitted_ground(np.array(middles).reshape(-1, 2), positions)
    if ground is None:
        return None
    known = Intrinsics(None, view.camera)
    place = geo_place_in(ground, model, view.size, known, answer.expected_error)
    if place is None:
        return None
    return replace(place, error=math.hypot(place.error or 0.0, ground.accuracy), source=source)


def _of_images(answers: Sequence[MapAnswer]) -> dict[str, Matrix3]:
    """Return the homography from each map image to the query, by the best answer in it."""
    found: dict[str, Matrix3] = {}
    for each in answers:
        if not isinstance(each.far_from_near, RelativePose):
            found.setdefault(each.image, np.linalg.inv(each.far_from_near))
    return found


def with_distortion(answer: MapAnswer, view: LensView) -> MapAnswer:
    """Return an answer for pixels of the original query, with the distortion of its lens."""
    camera, model, corners = view.camera, answer.far_from_near, answer.footprint
    if camera is None or camera.lens is None:
        return answer
    if isinstance(model, np.ndarray):
        model = _of_undistorted(model, view)
        corners = outline_in_far(model, Intrinsics(None, camera), *view.size)
    points = answer.points
    near = view.original(points.near)
    seen = np.isfinite(near).all(axis=1)
    return replace(
        answer,
        far_from_near=model,
        footprint=corners,
        points=PointMatches(points.far[seen], near[seen], points.inliers[seen]),
        alternatives=tuple(
            replace(each, far_from_near=_of_undistorted(each.far_from_near, view))
            for each in answer.alternatives
        ),
    )


def _of_undistorted(map_from_frame: Matrix3, view: LensView) -> Matrix3:
    """Return a homography from undistorted pixels of the query."""
    return normalized(map_from_frame @ np.linalg.inv(view.undistorted_from_frame))


def place_with_distortion(candidate: VerifiedCandidate, view: LensView) -> VerifiedCandidate:
    """Return a candidate with its place for pixels of the original query."""
    place, camera = candidate.place, view.camera
    if place is None or camera is None or camera.lens is None:
        return candidate
    model = _of_undistorted(place.far_from_near, view)
    corners = outline_in_far(model, Intrinsics(None, camera), *view.size)
    found = None if corners is None else replace(place, far_from_near=model, footprint=corners)
    return replace(candidate, place=found)
