"""The tracker: follows a camera through the images of a map by homographies."""

import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.errors import SettingsError
from nearfar.geometry.camera_files import CameraSource, read_camera
from nearfar.geometry.homography import normalized
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import Image, ImageSource, read_image
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.undistorted import view_of
from nearfar.maps.map import Map
from nearfar.tracking.constants import BUDGET, TRACKING, TrackingConstants
from nearfar.tracking.earth import Earth
from nearfar.tracking.hypotheses import Hypothesis, weighed
from nearfar.tracking.matching import Frame, FrameMatcher, Measurement
from nearfar.tracking.place import covariance_of, place_of
from nearfar.tracking.recovery import (
    LOW_CONFIDENCE,
    MapSearch,
    Searched,
    hypotheses_of,
    located,
)
from nearfar.tracking.state import TrackState
from nearfar.tracking.windows import Windows


class Tracker:
    """Follows a camera through a map, frame by frame.

    Each frame is matched where the last ones say that it lies. Where that fails, its neighbourhood
    and the motion between frames are tried, and then the whole map is searched. A tracker belongs
    to one thread, and shares nothing with other trackers.

    Args:
        map_: the map; it must not be changed meanwhile.
        intrinsics: camera that takes the frames, "query" of a file or mapping; its distortion is
            undone.
        budget: seconds that an update may take. A longer search of the whole map goes on in a
            thread while places are predicted, so that results depend on the time it takes.
            Infinite: an update waits for the search.
        constants: of all steps.

    Raises:
        IntrinsicsError: the intrinsics cannot be read.
        SettingsError: `budget` is not above 0.
    """

    def __init__(
        self,
        map_: Map,
        *,
        intrinsics: CameraSource | None = None,
        budget: float = BUDGET,
        constants: TrackingConstants = TRACKING,
    ) -> None:
        self._map, self._budget, self._constants = map_, budget, constants
        self._camera = None if intrinsics is None else read_camera(intrinsics, "query")
        self._windows = Windows(map_, map_.settings.max_pixels, constants.window)
        self._matcher = FrameMatcher(map_.settings, constants)
        self._search = MapSearch(map_, budget, LOW_CONFIDENCE, located)
        self._earth = Earth(map_.folder)
        self._followed: tuple[Hypothesis, ...] = ()
        self._lens = _Lens(None, np.eye(3), (0, 0))
        self._anchor: _Anchor | None = None
        self._index, self._time, self._missed = -1, -math.inf, 0
        self._next_search = 0
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
        """Find where the next frame lies.

        Args:
            image: path or array (RGB) of the frame.
            time: of the frame in seconds, larger than that of the last one; None: one second more.
            name: of the frame, for the result.

        Raises:
            ImageError: the frame cannot be read; the tracker is as before.
            MapError: a file of the map is missing, has changed or cannot be read.
            SettingsError: the time is not larger.
        """
        began = clock.perf_counter()
        settings = self._map.settings
        read = read_image(
            image,
            max_pixels=settings.max_pixels,
            bands=settings.bands,
            channels=settings.channels,
        )
        view = view_of(read, self._camera_of(read))
        frame = Frame(MaskedImage(view.image.pixels, view.image.mask), self._constants.odometry)
        self._lens = _Lens(view.camera, view.undistorted_from_frame, view.size)
        now = self._advanced(time)
        followed = self._after(frame, now, began + self._budget)
        limits = self._constants
        followed = [each for each in followed if each.share < limits.motion.given_up]
        self._followed = weighed(followed, limits.hypotheses)
        self._remember(frame, now)
        return replace(self._state(name), seconds=clock.perf_counter() - began)

    def skip(
        self, reason: str, time: float | None = None, *, name: str | None = None
    ) -> TrackState:
        """Predict the place of a frame that cannot be read.

        Args:
            reason: why there is no frame.
            time: see `update`.
            name: see `update`.

        Raises:
            SettingsError: the time is not larger than that of the last frame.
        """
        now = self._advanced(time)
        self._followed = tuple(
            replace(each.at(now), missed=each.missed + 1) for each in self._followed
        )
        self._missed += 1
        return self._state(name, reason)

    def checkpoint(self) -> dict[str, Any]:
        """Return what a tracker of the same map needs to go on, as JSON values."""
        return {
            "index": self._index,
            "time": self._time if math.isfinite(self._time) else None,
            "missed": self._missed,
            "next_search": self._next_search,
            "anchor": None if self._anchor is None else self._anchor.index,
            "followed": [each.to_dict() for each in self._followed],
        }

    def restore(self, content: Mapping[str, Any], anchor: ImageSource | None = None) -> None:
        """Go on from a checkpoint.

        Args:
            content: what `checkpoint` returned.
            anchor: the frame whose number is "anchor" in it, from which the motion is measured;
                None does without.

        Raises:
            ImageError: the frame cannot be read.
        """
        time = content["time"]
        self._index = int(content["index"])
        self._time = -math.inf if time is None else float(time)
        self._missed = int(content["missed"])
        self._next_search = int(content["next_search"])
        motion = self._constants.motion
        self._followed = tuple(Hypothesis.from_dict(each, motion) for each in content["followed"])
        self._anchor = None
        bases = [each.base.time for each in self._followed if each.base is not None]
        if anchor is not None and bases:
            read = read_image(anchor, max_pixels=self._map.settings.max_pixels)
            view = view_of(read, self._camera_of(read))
            self._lens = _Lens(view.camera, view.undistorted_from_frame, view.size)
            seen = view.image
            frame = Frame(MaskedImage(seen.pixels, seen.mask), self._constants.odometry)
            self._anchor = _Anchor(int(content["anchor"]), max(bases), frame)

    def _camera_of(self, image: Image) -> CameraIntrinsics | None:
        if self._camera is None:
            return None
        return self._camera.of_size(image.width, image.height, "query")

    def _advanced(self, time: float | None) -> float:
        """Return the time of the next frame, and make it the latest one."""
        last = self._time if math.isfinite(self._time) else -1.0
        now = last + 1.0 if time is None else float(time)
        if not now > self._time:
            raise SettingsError(
                f"the time of a frame must be above that of the last one, {self._time}, not {now}"
            )
        self._index, self._time = self._index + 1, now
        return now

    def _after(self, frame: Frame, now: float, deadline: float) -> list[Hypothesis]:
        """Return the hypotheses at the time of a frame, matched where it matches."""
        motion = _FrameMotion(self._matcher, self._anchor, frame)
        followed = self._follow_all(self._followed, frame, now, motion, deadline)
        if any(each.measured is not None for each in followed):
            self._missed, self._next_search = 0, self._constants.recovery.patience + 1
            return followed
        self._missed += 1
        return followed + self._sought(frame, now, deadline)

    def _follow_all(
        self,
        every: Sequence[Hypothesis],
        frame: Frame,
        now: float,
        motion: "_FrameMotion",
        deadline: float,
    ) -> list[Hypothesis]:
        """Return hypotheses at the time of a frame; after the deadline only the first is matched.

        Args:
            every: hypotheses, the most probable first.
            frame: the frame.
            now: its time.
            motion: its motion.
            deadline: by `time.perf_counter`, in seconds.
        """
        found: list[Hypothesis] = []
        for before in every:
            if found and clock.perf_counter() >= deadline:
                found.append(replace(before.at(now), size=frame.size, missed=before.missed + 1))
            else:
                found.append(self._follow(before, frame, now, motion, deadline))
        return found

    def _follow(
        self,
        before: Hypothesis,
        frame: Frame,
        now: float,
        motion: "_FrameMotion",
        deadline: float,
    ) -> Hypothesis:
        """Return a hypothesis at the time of a frame: matched, carried or predicted."""
        predicted = replace(before.at(now), size=frame.size)
        found = self._at_prediction(predicted, frame)
        if found is not None:
            return predicted.matched(found, "prediction")
        carried = None
        if clock.perf_counter() < deadline:
            carried = motion.carried(predicted, self._constants)
        if carried is not None:
            found = self._near(carried.image, carried.map_from_frame, frame, carried)
            if found is not None:
                return predicted.matched(found, "odometry")
        if clock.perf_counter() < deadline and carried is None:
            found = self._near(predicted.image, predicted.map_from_frame, frame, None)
            if found is not None:
                return predicted.matched(found, "neighbourhood")
        return replace(carried or predicted, missed=before.missed + 1)

    def _at_prediction(self, predicted: Hypothesis, frame: Frame) -> Measurement | None:
        """Return a measurement within the gate of a prediction."""
        found = self._near(predicted.image, predicted.map_from_frame, frame, predicted)
        if found is None:
            return None
        covariance = covariance_of(found.expected_error, predicted.radius)
        away = predicted.motion.away(place_of(found.map_from_frame, frame.size), covariance)
        return found if away < self._constants.match.gate else None

    def _near(
        self, image: str, model: Matrix3, frame: Frame, expected: Hypothesis | None
    ) -> Measurement | None:
        """Match a frame where a hypothesis expects it; in its neighbourhood without one."""
        move = None if expected is None else expected.move
        window = self._windows.around(image, model, frame.size, move)
        seen = None if window is None else self._matcher.seen(window, frame, model)
        if seen is None:
            return None
        if expected is None:
            found = self._matcher.around(seen)
        else:
            found = self._matcher.near(seen, self._reach(expected))
        sure = found is not None and found.confidence >= self._constants.match.least_confidence
        return found if sure else None

    def _reach(self, predicted: Hypothesis) -> float:
        """Return how far from a prediction matches may lie, as a share of the diagonal."""
        limits, covariance = self._constants.match, predicted.motion.place_covariance
        radius = predicted.radius
        turning = radius * math.sqrt(covariance[2, 2] + covariance[3, 3])
        reach = limits.deviations * math.hypot(predicted.motion.spread, turning) / (2 * radius)
        return min(max(reach, limits.least_reach), limits.most_reach)

    def _sought(self, frame: Frame, now: float, deadline: float) -> list[Hypothesis]:
        """Search the whole map for a frame that matches nowhere."""
        limits = self._constants.recovery
        searched = self._search.ready(0.0)
        due = self._missed >= self._next_search
        worth = due and len(frame.points) >= limits.least_points
        if searched is None and worth and not self._search.busy:
            self._next_search = self._missed + min(max(1, self._missed), limits.longest_pause)
            searched = self._search.search(frame, now, thorough=not self._followed)
        if searched is None and self._search.busy:
            searched = self._search.ready(deadline - clock.perf_counter())
        if searched is not None:
            self._unfound = "the frame matches the map nowhere"
            return self._found(searched, frame, now, deadline)
        if self._search.busy:
            self._unfound = "the search of the whole map goes on"
        elif due:
            self._unfound = "the frame shows too little to search the map for it"
        else:
            frames = self._next_search - self._missed
            self._unfound = f"the whole map is searched again {frames} frames later"
        return []

    def _found(
        self, searched: Searched[Frame], frame: Frame, now: float, deadline: float
    ) -> list[Hypothesis]:
        """Return the places that a search of the map found, at the time of the frame."""
        constants = self._constants
        found = hypotheses_of(searched, constants.motion, constants.hypotheses, constants.recovery)
        if searched.time == now:
            return found
        motion = _FrameMotion(self._matcher, _Anchor(-1, searched.time, searched.frame), frame)
        later = self._follow_all(found, frame, now, motion, deadline)
        return [replace(each, step="map") if each.measured is not None else each for each in later]

    def _remember(self, frame: Frame, now: float) -> None:
        """Measure the motion of the next frames from this one, if its place is known."""
        if any(each.base is not None and each.base.time == now for each in self._followed):
            self._anchor = _Anchor(self._index, now, frame)

    def _state(self, name: str | None, reason: str | None = None) -> TrackState:
        best = self._followed[0] if self._followed else None
        size = self._lens.size
        count = len(self._followed)
        if best is None or best.share > self._constants.motion.lost:
            why = reason or self._unfound
            return TrackState(
                self._index, self._time, "lost", size, hypotheses=count, reason=why, name=name
            )
        measured = best.measured
        model = normalized(best.map_from_frame @ np.linalg.inv(self._lens.undistorted_from_frame))
        state = TrackState(
            index=self._index,
            time=self._time,
            status="predicted"
            if measured is None
            else ("relocalized" if best.step == "map" else "tracked"),
            size=size,
            image=best.image,
            far_from_near=model,
            place=best.motion.place.copy()
            if measured is None
            else place_of(measured.map_from_frame, best.size),
            covariance=best.motion.place_covariance.copy(),
            confidence=0.0 if measured is None else measured.confidence * best.weight,
            expected_error=None if measured is None else measured.expected_error,
            inliers=0 if measured is None else measured.inliers,
            step=best.step,
            hypotheses=count,
            reason=None
            if measured is not None
            else (reason or "the frame does not match the map where it is expected"),
            name=name,
        )
        return self._earth.placed(state, self._lens.camera, best.radius)


@dataclass(frozen=True, eq=False)
class _Lens:
    """The camera of the latest frame that could be read.

    Attributes:
        camera: for the size of that frame; None where it is not known.
        undistorted_from_frame: pixels of the matched frame to undistorted ones.
        size: width and height of the original frame.
    """

    camera: CameraIntrinsics | None
    undistorted_from_frame: Matrix3
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Anchor:
    """The frame that the motion of later ones is measured from.

    Attributes:
        index: number of the frame.
        time: of the frame.
        frame: the frame.
    """

    index: int
    time: float
    frame: Frame


class _FrameMotion:
    """Motion from the anchor to a frame, measured when it is first asked for."""

    def __init__(self, matcher: FrameMatcher, anchor: _Anchor | None, frame: Frame) -> None:
        self._matcher, self._anchor, self._frame = matcher, anchor, frame
        self._asked = False
        self._found: Measurement | None = None

    def carried(self, predicted: Hypothesis, constants: TrackingConstants) -> Hypothesis | None:
        """Return a hypothesis at the place that the motion gives; None where it is not known."""
        anchor, base = self._anchor, predicted.base
        if anchor is None or base is None or base.time != anchor.time:
            return None
        if not self._asked:
            self._asked = True
            self._found = self._matcher.odometry(anchor.frame, self._frame)
        if self._found is None:
            return None
        model = normalized(base.map_from_frame @ self._found.map_from_frame)
        place = place_of(model, predicted.size)
        if not np.isfinite(place).all():
            return None
        scale = math.exp(place_of(base.map_from_frame, predicted.size)[2])
        added = covariance_of(
            scale * self._found.expected_error + constants.odometry.drift * predicted.radius,
            predicted.radius,
        )
        return predicted.carried(model, base.covariance + added)
