"""The tracker of poses: follows a camera through map images whose poses are known."""

import math
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from nearfar.errors import MapError, SettingsError
from nearfar.geometry.camera_files import CameraSource, read_camera
from nearfar.imaging.image import ImageSource, read_image
from nearfar.imaging.mask import MaskedImage
from nearfar.maps.answers import MapLocalization
from nearfar.maps.map import Map
from nearfar.maps.world.places import QueryPose
from nearfar.maps.world.pose_store import PoseStore
from nearfar.tracking.constants import BUDGET
from nearfar.tracking.recovery import MapSearch
from nearfar.tracking.state import TrackState

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PoseConstants:
    """What the tracker expects of poses; lengths are shares of the distance of map images."""

    candidates: int = 3
    """Map images near the expected place that are verified: a pose needs at least two."""
    measured: float = 0.05
    """Standard deviation of a measured centre, as a share of the distance of neighbouring map
    images. On KITTI the median error is about a hundredth of it, and a few are off by more."""
    first_speed: float = 1.0
    """Standard deviation of the first speed, in such distances a second."""
    acceleration: float = 0.3
    """Standard deviation of the acceleration, in such distances a squared second."""
    gate: float = 4.0
    """Largest distance of a measured centre from the predicted one, in standard deviations."""
    lost: float = 1.0
    """Standard deviation of the centre, in such distances, from which on the camera is lost."""
    longest_pause: int = 8
    """Most frames between two searches of the map; they grow with the frames without a pose."""


class PoseTracker:
    """Follows a camera through a map with poses, frame by frame.

    Each frame is matched with the map images nearest to its predicted centre. Where they give no
    pose near it, the whole map is searched. A tracker belongs to one thread.

    Args:
        map_: the map, with poses of one world.
        intrinsics: camera that takes the frames, "query" of a file or mapping.
        budget: seconds that an update may take, see `Tracker`.
        constants: of the tracker.

    Raises:
        IntrinsicsError: the intrinsics cannot be read.
        MapError: the map has fewer than two poses.
        SettingsError: `budget` is not above 0.
    """

    def __init__(
        self,
        map_: Map,
        *,
        intrinsics: CameraSource,
        budget: float = BUDGET,
        constants: PoseConstants | None = None,
    ) -> None:
        self._map, self._constants = map_, constants or PoseConstants()
        self._camera = read_camera(intrinsics, "query")
        least = map_.settings.min_confidence
        settings = map_.settings.replace(
            budget=min(map_.settings.budget, budget / 2), bands="", channels="rgb"
        )
        self._nearby = Map(map_.folder, settings)
        self.budget, self._search = budget, MapSearch(map_, budget, least, self._located)
        names = {image.id: image.name for image in map_.images if image.usable}
        posed = PoseStore(map_.folder).get(list(names))
        if len(posed) < 2:
            raise MapError("the map has fewer than two images with poses: build it with --poses")
        self._names = [names[key] for key in posed]
        self._centres = np.array([each.centre for each in posed.values()])
        self._spacing = _spacing(self._centres)
        self._index, self._time = -1, -math.inf
        self._mean: Array | None = None
        self._covariance = np.zeros((6, 6))
        self._rotation: Array = np.eye(3)
        self._world = ""
        self._missed = self._next_search = 0
        self._unfound = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread that searches the map, if there is one."""
        self._search.close()

    def update(
        self, image: ImageSource, time: float | None = None, *, name: str | None = None
    ) -> TrackState:
        """Find the pose of the next frame; see `Tracker.update`.

        Raises:
            ImageError: the frame cannot be read; the tracker is as before.
            SettingsError: the time is not larger than that of the last frame.
        """
        began = clock.perf_counter()
        settings = self._map.settings
        read = read_image(
            image,
            max_pixels=settings.max_pixels,
            bands=settings.bands,
            channels=settings.channels,
        )
        frame = MaskedImage(read.pixels, read.mask)
        self._advance(time)
        deadline = began + self.budget
        found = self._near(frame, deadline)
        tracked = found is not None
        if found is not None:
            self._missed = self._next_search = 0
            self._take(found[0], begin=False)
        else:
            self._missed += 1
            found = self._sought(frame, deadline)
        state = self._state((read.width, read.height), name, found, tracked=tracked)
        return replace(state, seconds=clock.perf_counter() - began)

    def _state(
        self, size: tuple[int, int], name: str | None, found: "Found | None", *, tracked: bool
    ) -> TrackState:
        if found is None:
            return self._predicted(size, name, self._unfound)
        pose, confidence = found
        return TrackState(
            self._index,
            self._time,
            "tracked" if tracked else "relocalized",
            size,
            image=pose.images[0],
            inliers=pose.inliers,
            step="prediction" if tracked else "map",
            hypotheses=1,
            name=name,
            world=pose,
            pose_covariance=self._covariance[:3, :3].copy(),
            confidence=confidence,
        )

    def skip(
        self, reason: str, time: float | None = None, *, name: str | None = None
    ) -> TrackState:
        """Predict the pose of a frame that cannot be read; see `Tracker.skip`."""
        self._advance(time)
        return self._predicted((0, 0), name, reason)

    def checkpoint(self) -> dict[str, Any]:
        """Return what a tracker of the same map needs to go on, as JSON values."""
        return {
            "index": self._index,
            "time": self._time if math.isfinite(self._time) else None,
            "anchor": None,
            "mean": None if self._mean is None else self._mean.tolist(),
            "covariance": self._covariance.tolist(),
            "rotation": self._rotation.tolist(),
            "world": self._world,
            "missed": self._missed,
            "next_search": self._next_search,
        }

    def restore(self, content: Mapping[str, Any], anchor: ImageSource | None = None) -> None:  # noqa: ARG002
        """Go on from a checkpoint; the last frame is not needed."""
        time, mean = content["time"], content["mean"]
        self._index = int(content["index"])
        self._time = -math.inf if time is None else float(time)
        self._mean = None if mean is None else np.array(mean, np.float64)
        self._covariance = np.array(content["covariance"], np.float64)
        self._rotation = np.array(content["rotation"], np.float64)
        self._world = str(content["world"])
        self._missed, self._next_search = int(content["missed"]), int(content["next_search"])

    def _advance(self, time: float | None) -> None:
        """Predict to the time of the next frame: constant velocity of the centre."""
        now = (self._time + 1.0 if math.isfinite(self._time) else 0.0) if time is None else time
        if not now > self._time:
            raise SettingsError(
                f"the time of a frame must be above that of the last one, {self._time}, not {now}"
            )
        self._predict(float(now))
        self._index += 1

    def _predict(self, now: float) -> None:
        """Move the filter on to a time."""
        step = now - self._time
        if self._mean is not None:
            forward = np.eye(6)
            forward[:3, 3:] = step * np.eye(3)
            density = (self._constants.acceleration * self._spacing) ** 2
            noise = np.kron([[step**3 / 3, step**2 / 2], [step**2 / 2, step]], np.eye(3))
            self._mean = forward @ self._mean
            self._covariance = forward @ self._covariance @ forward.T + density * noise
        self._time = now

    def _near(self, frame: MaskedImage, deadline: float) -> "Found | None":
        """Return the pose by the map images nearest to the prediction, if it lies near it."""
        mean = self._mean
        if mean is None or clock.perf_counter() >= deadline:
            return None
        away = np.linalg.norm(self._centres - mean[:3], axis=1)
        count = self._constants.candidates
        names = [self._names[k] for k in np.argsort(away, kind="stable")[:count]]
        found = _posed(
            self._nearby.locate(
                frame.pixels,
                mask=_mask(frame),
                candidates=count,
                intrinsics=self._camera,
                among=names,
            )
        )
        if found is None:
            return None
        innovation = np.asarray(found[0].translation) - mean[:3]
        total = self._covariance[:3, :3] + self._noise
        surprise = math.sqrt(innovation @ np.linalg.solve(total, innovation))
        return found if surprise < self._constants.gate else None

    def _sought(self, frame: MaskedImage, deadline: float) -> "Found | None":
        """Return the pose by the whole map: of this frame, or of an earlier one moved on."""
        searched = self._search.ready(0.0)
        due = self._missed >= self._next_search
        if searched is None and due and not self._search.busy:
            self._next_search = self._missed + min(self._missed, self._constants.longest_pause)
            searched = self._search.search(frame, self._time, thorough=self._mean is None)
        if searched is None and self._search.busy:
            searched = self._search.ready(deadline - clock.perf_counter())
        if searched is None:
            self._unfound = "the search of the whole map goes on"
            if not self._search.busy:
                frames = self._next_search - self._missed
                self._unfound = f"the whole map is searched again {frames} frames later"
            return None
        self._unfound = "no map image gives a pose of the frame"
        found, now = _posed(searched.found), self._time
        if found is None:
            return None
        self._missed = self._next_search = 0
        self._time = searched.time
        self._take(found[0], begin=True)
        if searched.time == now:
            return found
        self._predict(now)
        later = self._near(frame, math.inf)
        if later is not None:
            self._take(later[0], begin=False)
        return later

    def _located(self, map_: Map, frame: MaskedImage, thorough: bool) -> MapLocalization:
        return map_.locate(
            frame.pixels, mask=_mask(frame), intrinsics=self._camera, simulated_views=thorough
        )

    @property
    def _noise(self) -> Array:
        """Return the (3, 3) covariance of a measured centre."""
        return (self._constants.measured * self._spacing) ** 2 * np.eye(3)

    def _take(self, pose: QueryPose, *, begin: bool) -> None:
        """Update the filter with a pose; begin anew with one that the whole map gave."""
        centre = np.asarray(pose.translation, np.float64)
        if begin or self._mean is None:
            speed = (self._constants.first_speed * self._spacing) ** 2 * np.eye(3)
            self._mean = np.concatenate([centre, np.zeros(3)])
            self._covariance = np.zeros((6, 6))
            self._covariance[:3, :3], self._covariance[3:, 3:] = self._noise, speed
        else:
            total = self._covariance[:3, :3] + self._noise
            gain = np.linalg.solve(total, self._covariance[:3]).T
            moved = self._mean + gain @ (centre - self._mean[:3])
            self._mean = np.asarray(moved, np.float64)
            left = self._covariance - gain @ self._covariance[:3]
            self._covariance = np.asarray(left, np.float64)
        self._rotation = np.asarray(pose.rotation, np.float64)
        self._world = pose.world

    def _predicted(self, size: tuple[int, int], name: str | None, reason: str) -> TrackState:
        """Return the state of a frame that gives no pose."""
        spread = math.sqrt(float(np.linalg.eigvalsh(self._covariance[:3, :3])[-1]))
        if self._mean is None or spread > self._constants.lost * self._spacing:
            return TrackState(self._index, self._time, "lost", size, reason=reason, name=name)
        pose = QueryPose(self._world, self._rotation, self._mean[:3].copy(), None, "motion", 0, ())
        return TrackState(
            self._index,
            self._time,
            "predicted",
            size,
            step="motion",
            hypotheses=1,
            reason=reason,
            name=name,
            world=pose,
            pose_covariance=self._covariance[:3, :3].copy(),
        )


Found = tuple[QueryPose, float]
"""A pose with a centre, and its confidence."""


def _mask(frame: MaskedImage) -> NDArray[np.uint8] | None:
    return None if frame.mask is None else frame.mask.astype(np.uint8)


def _posed(located: MapLocalization) -> Found | None:
    """Return a pose with a centre, and the confidence of the best answer; None without one."""
    pose = located.pose
    if pose is None or pose.translation is None or not located.answers:
        return None
    return pose, located.answers[0].confidence


def _spacing(centres: Array) -> float:
    """Return the median distance of a map image's centre from the nearest other one."""
    apart = np.linalg.norm(centres[:, np.newaxis] - centres, axis=2)
    np.fill_diagonal(apart, np.inf)
    return max(float(np.median(apart.min(axis=1))), 1e-9)
