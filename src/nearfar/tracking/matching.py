"""Match a frame with a window of the map at one scale, and with another frame."""

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from nearfar.arrays import Coordinates, Matrix3
from nearfar.estimators import Estimator
from nearfar.features.detection import detect_rootsift
from nearfar.features.guided import Gate, nearest_within
from nearfar.features.keypoints import Keypoints
from nearfar.features.nearest import nearest_neighbours
from nearfar.geometry.homography import footprint, normalized, outline, transform, translation
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized, warped
from nearfar.methods.adaptive.attempt import Attempt, attempt
from nearfar.methods.adaptive.votes import hypotheses
from nearfar.methods.adaptive.zoom import Matched, inside
from nearfar.methods.points import tuned_estimator
from nearfar.models import Task
from nearfar.settings import Settings
from nearfar.tracking.constants import OdometryConstants, TrackingConstants
from nearfar.tracking.place import half_diagonal
from nearfar.tracking.similarity import similarity_fit
from nearfar.tracking.windows import Window
from nearfar.verification.confidence import confidence
from nearfar.verification.expected_error import ExpectedError, with_expected_error

EVERYWHERE = 1e6
"""Reach in pixels that excludes no match."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame without the distortion of its lens.

    Attributes:
        image: pixels and mask.
        odometry: constants of the motion between frames.
    """

    image: MaskedImage
    odometry: OdometryConstants

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height in pixels."""
        return self.image.size

    @functools.cached_property
    def points(self) -> Keypoints:
        """Return keypoints of the reduced frame, in pixels of the frame."""
        factor = min(1.0, self.odometry.longest_side / max(self.size))
        small, small_from_frame = resized(self.image.pixels, factor)
        found = detect_rootsift(small, self.odometry.contrast, self.odometry.points)
        found = inside(found, small_from_frame, self.image)
        scale = found.scale / small_from_frame[0, 0]
        own = transform(np.linalg.inv(small_from_frame), found.xy)
        return replace(found, xy=own, scale=scale)


@dataclass(frozen=True, eq=False)
class Measurement:
    """A place of a frame that matches confirm.

    Attributes:
        map_from_frame: homography from pixels of the frame to pixels of the map image.
        inliers: number of matches that agree with it.
        log10_nfa: decimal logarithm of the number of false alarms.
        confidence: calibrated probability that the place is right and exact.
        expected_error: expected mean error over the frame, in map pixels.
    """

    map_from_frame: Matrix3
    inliers: int
    log10_nfa: float
    confidence: float
    expected_error: float


class FrameMatcher:
    """Matches frames with windows and with each other.

    Args:
        settings: settings of the method `adaptive`.
        constants: of the tracker.
    """

    def __init__(self, settings: Settings, constants: TrackingConstants) -> None:
        self._settings, self._constants = settings, constants
        self._estimator: Estimator = tuned_estimator(settings)

    def seen(self, window: Window, frame: Frame, expected: Matrix3) -> "SeenFrame | None":
        """Return the keypoints of a frame in a window; None where they do not overlap.

        Args:
            window: the window.
            frame: the frame.
            expected: homography from pixels of the frame to pixels of the map image.
        """
        window_from_frame = window.window_from_map @ expected
        corners = footprint(window_from_frame, *frame.size)
        if corners is None:
            return None
        low = np.maximum(np.floor(corners.min(axis=0)), 0)
        high = np.minimum(np.ceil(corners.max(axis=0)), np.array(window.size) - 1)
        if (high - low < 8).any():
            return None
        part_from_frame = translation(*-low) @ window_from_frame
        width, height = (int(side) for side in high - low + 1)
        seen = warped(frame.image.pixels, part_from_frame, (width, height))
        limits = self._constants.window
        points = detect_rootsift(seen, limits.contrast, limits.frame_points)
        points = inside(points, part_from_frame, frame.image)
        points = replace(points, xy=points.xy + low)
        diagonal = float(np.hypot(*(np.ptp(corners, axis=0))))
        return SeenFrame(window, frame, window_from_frame, points, diagonal)

    def near(self, seen: "SeenFrame", reach: float) -> Measurement | None:
        """Match within a reach of the expected place, then again at the place that was found.

        Args:
            seen: the frame as it was expected.
            reach: distance from the expected place, as a share of the footprint's diagonal.
        """
        found = self._fitted(seen, seen.matched(reach, self._constants))
        return self._refined(seen, found)

    def around(self, seen: "SeenFrame") -> Measurement | None:
        """Match in the neighbourhood; None where two places are as good as each other."""
        limits = self._constants.match
        wide = seen.matched(limits.wide_reach, self._constants, turned=True)
        votes = replace(wide.tentative, constants=self._constants.method.votes)
        found = hypotheses(votes, 2, "votes")
        if not found or (len(found) > 1 and found[1].support > limits.rival * found[0].support):
            return None
        moved = seen.moved(found[0].far_from_near)
        return self._refined(moved, self._fitted(moved, moved.matched(0.1, self._constants)))

    def odometry(self, before: Frame, frame: Frame) -> Measurement | None:
        """Return the motion since another frame: the homography from this frame to that one."""
        limits = self._constants.odometry
        if min(len(before.points), len(frame.points)) < limits.least_inliers:
            return None
        nearest = nearest_neighbours(before.points, frame.points)
        matched = Matched.of(before.points, frame.points, nearest, limits.ratio)
        found = self._attempt(matched, before.size, "odometry")
        inliers = int(found.estimate.inliers.sum())
        if inliers < limits.least_inliers:
            return None
        return self._measured(found, frame.size)

    def _refined(self, seen: "SeenFrame", found: Attempt | None) -> Measurement | None:
        if found is None:
            return None
        model = np.asarray(found.estimate.far_from_near)
        window_from_frame = seen.window.window_from_map @ model
        moved = seen.moved(window_from_frame @ np.linalg.inv(seen.window_from_frame))
        reach = self._constants.match.narrow_reach
        again = self._fitted(moved, moved.matched(reach, self._constants))
        if again is not None and again.estimate.inliers.sum() >= found.estimate.inliers.sum():
            found = replace(again, log10_nfa=min(again.log10_nfa, found.log10_nfa))
        exact = self._measured(found, seen.frame.size)
        if exact is not None and exact.confidence >= self._constants.match.least_confidence:
            return exact
        return self._stiff(found, seen) or exact

    def _stiff(self, found: Attempt, seen: "SeenFrame") -> Measurement | None:
        """Return the similarity transform from the predicted place.

        It needs fewer inliers than a homography, and they may lie in a corner.
        """
        limits = self._constants.match
        inliers = found.estimate.inliers
        far, near = found.far[inliers], found.near[inliers]
        if len(far) < limits.least_stiff or not self._significant(found):
            return None
        predicted = np.linalg.inv(seen.window.window_from_map) @ seen.window_from_frame
        fitted = similarity_fit(transform(predicted, near), far)
        if fitted is None:
            return None
        model = normalized(fitted.matrix @ predicted)
        corners = transform(model, outline(*seen.frame.size))
        radius = half_diagonal(model, seen.frame.size)
        error = math.hypot(fitted.error(corners), limits.bend * radius)
        sure = confidence("homography", found.log10_nfa, ExpectedError(error))
        return Measurement(model, len(far), found.log10_nfa, sure, error)

    def _significant(self, found: Attempt) -> bool:
        return found.log10_nfa <= math.log10(self._settings.max_false_alarms)

    def _fitted(self, seen: "SeenFrame", matched: Matched) -> Attempt | None:
        found = self._attempt(matched, seen.window.size, "tracking")
        return found if math.isfinite(found.log10_nfa) else None

    def _attempt(self, matched: Matched, size: tuple[int, int], step: str) -> Attempt:
        acceptance = self._constants.method.acceptance
        task = Task("homography")
        return attempt([matched], task, self._estimator, size, step, constants=acceptance)

    def _measured(self, found: Attempt, size: tuple[int, int]) -> Measurement | None:
        """Return a measurement unless chance explains it or its matches leave it open."""
        model, inliers = found.estimate.far_from_near, found.estimate.inliers
        if model is None or not self._significant(found):
            return None
        homography = np.asarray(model)
        far, near = found.far[inliers], found.near[inliers]
        _, expected = with_expected_error(
            homography, "homography", far, near, size, 1.0, self._constants.method.uncertainty
        )
        if expected is None:
            return None
        # The whole frame counts: a place that is known beyond the inliers is what is followed.
        sure = confidence("homography", found.log10_nfa, ExpectedError(expected.value))
        return Measurement(homography, int(inliers.sum()), found.log10_nfa, sure, expected.value)


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """A frame as it is expected in a window.

    Attributes:
        window: the window.
        frame: the frame.
        window_from_frame: the expected homography.
        points: keypoints of the frame, in pixels of the window at the expected place.
        diagonal: of the box around the expected footprint, in pixels of the window.
    """

    window: Window
    frame: Frame
    window_from_frame: Matrix3
    points: Keypoints
    diagonal: float

    def moved(self, window_from_window: Matrix3) -> "SeenFrame":
        """Return the frame at another place, with the keypoints that were detected."""
        linear = window_from_window[:2, :2]
        scale = math.sqrt(abs(np.linalg.det(linear)))
        turn = math.atan2(linear[1, 0] - linear[0, 1], linear[0, 0] + linear[1, 1])
        points = replace(
            self.points,
            xy=transform(window_from_window, self.points.xy),
            scale=scale * self.points.scale,
            angle=self.points.angle + turn,
        )
        moved = window_from_window @ self.window_from_frame
        return SeenFrame(self.window, self.frame, moved, points, scale * self.diagonal)

    def matched(
        self, reach: float, constants: TrackingConstants, *, turned: bool = False
    ) -> Matched:
        """Match the keypoints within a reach.

        Args:
            reach: distance from the expected place, as a share of the footprint's diagonal.
            constants: of the matching.
            turned: allow any orientation and size; the matches are in pixels of the window then.

        Returns:
            Matches in pixels of the map image and of the frame.
        """
        limits = constants.match
        radius = max(reach * self.diagonal, constants.method.zoom.least_reach)
        size = EVERYWHERE if turned else limits.size_tolerance
        angle = math.pi if turned else math.radians(limits.angle_tolerance)
        far = self._within(radius)
        found = Matched.of(
            far,
            self.points,
            nearest_within(far, self.points, Gate(radius, size, angle), limits.cell),
            limits.ratio,
        )
        return replace(
            found,
            far=transform(np.linalg.inv(self.window.window_from_map), found.far),
            near=self._in_frame(found.near),
            radius=radius / self.window.enlarged,
        )

    def _within(self, radius: float) -> Keypoints:
        """Return the keypoints of the window that lie within a radius of the frame's."""
        if not len(self.points):
            return self.window.points[:0]
        low, high = self.points.xy.min(axis=0) - radius, self.points.xy.max(axis=0) + radius
        every = self.window.points
        return every[((every.xy >= low) & (every.xy <= high)).all(axis=1)]

    def _in_frame(self, xy: Coordinates) -> Coordinates:
        return transform(np.linalg.inv(self.window_from_frame), xy)
