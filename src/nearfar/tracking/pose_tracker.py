"""The tracker of poses: follows a camera through map images whose poses are known."""

import math
import time as clock
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from nearfar.errors import SettingsError
from nearfar.geometry.camera_files import CameraSource, read_camera
from nearfar.imaging.image import ImageSource, read_image
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.undistorted import view_of
from nearfar.maps.answers import MapLocalization
from nearfar.maps.map import Map
from nearfar.maps.world.places import QueryPose
from nearfar.tracking.constants import BUDGET
from nearfar.tracking.mapped_points import MappedPoints, SceneMap
from nearfar.tracking.pose_matching import (
    Matching,
    MeasuredPose,
    PoseFrame,
    PoseMatchConstants,
    PredictedPose,
    by_points,
    by_tracks,
    measured,
)
from nearfar.tracking.pose_motion import PoseMotion, PoseMotionConstants
from nearfar.tracking.recovery import MapSearch, Searched
from nearfar.tracking.state import Step, TrackState

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PoseConstants:
    """Constants of the tracker of poses."""

    least_confidence: float = 0.5
    """Confidence below which a pose is no measurement."""
    longest_pause: int = 8
    """Most frames between two searches of the map; they grow with the frames without a pose."""
    images: int = 2
    """Map images nearest to the predicted place that a frame is matched with: triangulation needs
    two. On KITTI three were less accurate, since the poses of the map drift..."""
    more_images: int = 3
    """...but they may give a pose where two do not."""
    match: PoseMatchConstants = field(default_factory=PoseMatchConstants)
    motion: PoseMotionConstants = field(default_factory=PoseMotionConstants)


class PoseTracker:
    """Follows a camera through a map with poses, frame by frame.

    Each frame is matched with the map images nearest to its predicted pose: with their points of a
    model where the prediction puts them, or with keypoints that two of them show. Where that gives
    no pose near the prediction, more map images and the points that the last frame showed are
    tried, and then the whole map is searched. A tracker belongs to one thread.

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
        self._settings, self._constants = map_.settings, constants or PoseConstants()
        self._camera = read_camera(intrinsics, "query")
        self._scene = SceneMap(map_)
        self._spacing = self._scene.spacing
        least = map_.settings.min_confidence
        self._budget, self._search = budget, MapSearch(map_, budget, least, _located)
        self._index, self._time = -1, -math.inf
        self._motion: PoseMotion | None = None
        self._world = ""
        self._last: MappedPoints | None = None
        self._missed = self._next_search = 0
        self._unfound = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread that searches the map, if there is one."""
        self._search.close()

    @property
    def budget(self) -> float:
        """Return the seconds that an update may take."""
        return self._budget

    def update(
        self, image: ImageSource, time: float | None = None, *, name: str | None = None
    ) -> TrackState:
        """Find the pose of the next frame; see `Tracker.update`.

        Raises:
            ImageError: the frame cannot be read; the tracker is as before.
            SettingsError: the time is not larger than that of the last frame.
        """
        began = clock.perf_counter()
        settings = self._settings
        read = read_image(
            image,
            max_pixels=settings.max_pixels,
            bands=settings.bands,
            channels=settings.channels,
        )
        view = view_of(read, self._camera.of_size(read.width, read.height, "query"))
        assert view.pinhole is not None  # noqa: S101
        seen = MaskedImage(view.image.pixels, view.image.mask)
        frame = PoseFrame(seen, view.pinhole, self._constants.match)
        self._advance(time)
        state = self._found(frame, view.size, name, began + self._budget)
        return replace(state, seconds=clock.perf_counter() - began)

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
            "motion": None if self._motion is None else self._motion.to_dict(),
            "world": self._world,
            "missed": self._missed,
            "next_search": self._next_search,
        }

    def restore(self, content: Mapping[str, Any], anchor: ImageSource | None = None) -> None:  # noqa: ARG002
        """Go on from a checkpoint; the last frame is not needed."""
        time, motion = content["time"], content["motion"]
        self._index = int(content["index"])
        self._time = -math.inf if time is None else float(time)
        self._motion = None
        if motion is not None:
            self._motion = PoseMotion.from_dict(motion, self._spacing, self._constants.motion)
        self._world, self._last = str(content["world"]), None
        self._missed, self._next_search = int(content["missed"]), int(content["next_search"])

    def _advance(self, time: float | None) -> None:
        """Predict to the time of the next frame."""
        last = self._time if math.isfinite(self._time) else -1.0
        now = last + 1.0 if time is None else float(time)
        if not now > self._time:
            raise SettingsError(
                f"the time of a frame must be above that of the last one, {self._time}, not {now}"
            )
        if self._motion is not None:
            self._motion = self._motion.at(now)
        self._index, self._time = self._index + 1, now

    def _found(
        self, frame: PoseFrame, size: tuple[int, int], name: str | None, deadline: float
    ) -> TrackState:
        """Return the state of a frame: tracked, relocalized, predicted or lost."""
        near = self._near(frame, deadline)
        if near is not None:
            return self._taken(near[0], near[1], size, name)
        self._missed += 1
        searched = self._sought(frame, deadline)
        pose = None if searched is None else searched.found.pose
        if searched is None or pose is None or pose.translation is None:
            return self._predicted(size, name, self._unfound)
        now, self._time = self._time, searched.time
        state = self._begun(searched.found, pose, size, name)
        if now == searched.time:
            return state
        assert self._motion is not None  # noqa: S101
        self._time, self._motion = now, self._motion.at(now)
        near = self._near(frame, math.inf)
        if near is None:
            return self._predicted(size, name, "the search of the map found an earlier frame")
        return self._taken(near[0], "map", size, name)

    def _near(self, frame: PoseFrame, deadline: float) -> tuple[MeasuredPose, Step] | None:
        """Return a pose near the prediction, and what gave it."""
        motion = self._motion
        if motion is None or motion.given_up:
            return None
        expected = PredictedPose(motion.rotation, motion.centre, motion.spread, motion.turned)
        for step, matching in self._steps(frame, expected):
            if clock.perf_counter() >= deadline:
                return None
            found = measured(frame, matching, self._settings.seed)
            if found is None or found.confidence < self._constants.least_confidence:
                continue
            if motion.away(found.pose) < self._constants.motion.gate:
                return found, step
        return None

    def _steps(self, frame: PoseFrame, expected: PredictedPose) -> Iterator[tuple[Step, Matching]]:
        """Yield the ways to match a frame, the cheapest first."""
        at = self._world, expected.centre, expected.rotation
        images, points = self._scene.near(*at, self._constants.images)
        if points:
            yield "prediction", lambda scale: by_points(frame, points, expected, scale)
            yield "neighbourhood", lambda scale: by_points(frame, points, None, scale)
        else:
            yield "prediction", lambda scale: by_tracks(frame, images, scale)
        last = self._last
        if last is not None:
            yield "odometry", lambda scale: by_points(frame, [last], expected, scale)
        more, _ = self._scene.near(*at, self._constants.more_images)
        yield "neighbourhood", lambda scale: by_tracks(frame, more, scale)
        if last is not None:
            yield "odometry", lambda scale: by_points(frame, [last], None, scale)

    def _taken(
        self, found: MeasuredPose, step: Step, size: tuple[int, int], name: str | None
    ) -> TrackState:
        """Update the filter with a measured pose, and return the state."""
        assert self._motion is not None  # noqa: S101
        self._motion = self._motion.updated(found.pose)
        self._last, self._missed, self._next_search = found.seen, 0, 0
        pose = QueryPose(
            self._world,
            found.pose.rotation,
            found.pose.centre,
            None,
            "tracking",
            len(found.seen),
            found.images,
            found.pose.covariance,
        )
        return self._posed(pose, found.confidence, step, size, name)

    def _begun(
        self, located: MapLocalization, pose: QueryPose, size: tuple[int, int], name: str | None
    ) -> TrackState:
        """Begin the filter with a pose that the search of the map gave, and return the state."""
        self._motion = PoseMotion.begun(self._time, pose, self._spacing, self._constants.motion)
        self._world, self._last = pose.world, None
        self._missed = self._next_search = 0
        sure = located.answers[0].confidence if located.answers else 0.0
        return self._posed(pose, sure, "map", size, name)

    def _posed(
        self,
        pose: QueryPose,
        confidence: float,
        step: Step,
        size: tuple[int, int],
        name: str | None,
    ) -> TrackState:
        assert self._motion is not None  # noqa: S101
        return TrackState(
            self._index,
            self._time,
            "relocalized" if step == "map" else "tracked",
            size,
            image=pose.images[0],
            inliers=pose.inliers,
            step=step,
            hypotheses=1,
            name=name,
            world=pose,
            pose_covariance=self._motion.centre_covariance,
            confidence=confidence,
        )

    def _sought(self, frame: PoseFrame, deadline: float) -> Searched[PoseFrame] | None:
        """Search the whole map; return the result unless there is none yet."""
        searched = self._search.ready(0.0)
        due = self._missed >= self._next_search
        if searched is None and due and not self._search.busy:
            self._next_search = self._missed + min(self._missed, self._constants.longest_pause)
            searched = self._search.search(frame, self._time, thorough=self._motion is None)
        if searched is None and self._search.busy:
            searched = self._search.ready(deadline - clock.perf_counter())
        frames = self._next_search - self._missed
        if searched is not None:
            self._unfound = "no map image gives a pose of the frame"
        elif self._search.busy:
            self._unfound = "the search of the whole map goes on"
        else:
            self._unfound = f"the whole map is searched again {frames} frames later"
        return searched

    def _predicted(self, size: tuple[int, int], name: str | None, reason: str) -> TrackState:
        """Return the state of a frame that gives no pose."""
        motion = self._motion
        if motion is None or motion.lost:
            return TrackState(self._index, self._time, "lost", size, reason=reason, name=name)
        pose = QueryPose(self._world, motion.rotation, motion.centre, None, "motion", 0, ())
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
            pose_covariance=motion.centre_covariance,
        )


def _located(map_: Map, frame: PoseFrame, thorough: bool) -> MapLocalization:
    """Locate a frame in the whole map; with simulated views of it if `thorough`."""
    mask = None if frame.image.mask is None else frame.image.mask.astype(np.uint8)
    return map_.locate(
        frame.image.pixels,
        mask=mask,
        intrinsics=frame.camera,
        simulated_views=thorough,
    )
