"""The images of a map nearest to a camera, their keypoints, and the points of a model there."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.errors import MapError
from nearfar.features.keypoints import Keypoints
from nearfar.geometry.homography import transform
from nearfar.maps.map import Map
from nearfar.maps.store import MapStore
from nearfar.maps.tables import unpacked_keypoints
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.scene import OBSERVED_WITHIN, PosedImage

Array = NDArray[np.float64]

CACHED = 64
"""Map images whose keypoints and points are kept."""
GAZE = 75.0
"""Largest angle between the directions in which two cameras look that show the same, in degrees."""


@dataclass(frozen=True, eq=False)
class MappedImage:
    """A map image with its keypoints.

    Attributes:
        name: of the image.
        posed: its camera and pose.
        keypoints: in pixels of the image.
    """

    name: str
    posed: PosedImage
    keypoints: Keypoints


@dataclass(frozen=True, eq=False)
class MappedPoints:
    """N points of the scene, each with a keypoint of an image that shows it.

    Attributes:
        keypoints: N keypoints, in pixels of the image.
        points: (N, 3) in the world.
        centre: (3,) centre of the camera of the image.
        focal: its focal length, in pixels.
        image: name of the image.
    """

    keypoints: Keypoints
    points: Array
    centre: Array
    focal: float
    image: str

    def __len__(self) -> int:
        return len(self.points)


class SceneMap:
    """The images of a map whose poses are known, and the points that they show.

    Args:
        map_: the map.

    Raises:
        MapError: the map has fewer than two poses.
    """

    def __init__(self, map_: Map) -> None:
        self._store = MapStore(map_.folder)
        names = {image.id: image.name for image in map_.images if image.usable}
        posed = PoseStore(map_.folder).get(list(names))
        if len(posed) < 2:
            raise MapError("the map has fewer than two images with poses: build it with --poses")
        self._ids = list(posed)
        self._names = [names[key] for key in posed]
        self._posed = list(posed.values())
        self._centres = np.array([each.centre for each in self._posed])
        self._gazes = np.array([each.rotation[:, 2] for each in self._posed])
        self._worlds = np.array([each.world for each in self._posed], object)
        self._keypoints: LRUCache[int, Keypoints] = LRUCache(CACHED)
        self._points: LRUCache[int, MappedPoints] = LRUCache(CACHED)

    @property
    def worlds(self) -> list[str]:
        """Return the names of the map sources that the poses are from."""
        return sorted(set(self._worlds))

    @property
    def spacing(self) -> float:
        """Return the median distance of a map image's centre from the nearest other one."""
        nearest = []
        for index, centre in enumerate(self._centres):
            away = np.linalg.norm(self._centres - centre, axis=1)
            away[(np.arange(len(away)) == index) | (self._worlds != self._worlds[index])] = np.inf
            nearest.append(away.min())
        known = np.array(nearest)[np.isfinite(nearest)]
        return max(float(np.median(known)), 1e-9) if len(known) else 1e-9

    def near(
        self, world: str, centre: Array, rotation: Matrix3, count: int
    ) -> tuple[list[MappedImage], list[MappedPoints]]:
        """Return the map images nearest to a place, and the points of a model that they show.

        Args:
            world: name of the map source.
            centre: (3,) the place in it.
            rotation: (3, 3) of a camera there; images that look elsewhere are left out.
            count: number of images.

        Returns:
            The images, and their points; no points where the map source gives none.
        """
        away = np.linalg.norm(self._centres - centre, axis=1)
        limit = np.cos(np.radians(GAZE))
        away[(self._worlds != world) | (self._gazes @ rotation[:, 2] < limit)] = np.inf
        order = [int(each) for each in np.argsort(away, kind="stable")[:count]]
        chosen = [each for each in order if np.isfinite(away[each])]
        images = [
            MappedImage(self._names[each], self._posed[each], self._keypoints_of(each))
            for each in chosen
        ]
        return images, [self._points_of(each) for each in chosen if len(self._posed[each].points)]

    def _keypoints_of(self, index: int) -> Keypoints:
        """Return the stored keypoints of the whole of a map image, in its pixels."""
        if index not in self._keypoints:
            image = self._ids[index]
            whole = min(self._store.tiles(image), key=lambda each: each.scale)
            stored = self._store.keypoints(image, whole)
            found = unpacked_keypoints(stored or b"")
            self._keypoints[index] = replace(
                found,
                xy=transform(whole.original_from_tile, found.xy),
                scale=found.scale / whole.scale,
            )
        return self._keypoints[index]

    def _points_of(self, index: int) -> MappedPoints:
        """Return the keypoints of an image near observed points of the model, at their depths."""
        if index not in self._points:
            posed, keypoints = self._posed[index], self._keypoints_of(index)
            which, near = nearest_within(keypoints.xy, posed.observed, OBSERVED_WITHIN)
            known = posed.in_camera(posed.points[near])
            focal = [posed.camera.fx, posed.camera.fy]
            shifted = (keypoints.xy[which] - posed.observed[near]) / focal
            slope = known[:, :2] / known[:, 2:] + shifted
            on_ray = known[:, 2:] * np.column_stack([slope, np.ones(len(slope))])
            ahead = known[:, 2] > 0
            self._points[index] = MappedPoints(
                keypoints[which[ahead]],
                posed.in_world(on_ray[ahead]),
                posed.centre,
                (posed.camera.fx + posed.camera.fy) / 2,
                self._names[index],
            )
        return self._points[index]


def nearest_within(
    places: Coordinates, others: Coordinates, largest: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of places with another one within a distance, and of the nearest ones.

    Args:
        places: (N, 2).
        others: (M, 2).
        largest: largest distance.
    """
    if not len(places) or not len(others):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    found = cv2.BFMatcher(cv2.NORM_L2).match(places.astype(np.float32), others.astype(np.float32))
    near = [(each.queryIdx, each.trainIdx) for each in found if each.distance <= largest]
    first, second = np.array(near, np.intp).reshape(-1, 2).T
    return first, second
