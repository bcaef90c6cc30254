"""What the tracker says of a frame."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.errors import LocalizationError
from nearfar.geometry.homography import footprint
from nearfar.maps.world.places import GeoPlace, QueryPose
from nearfar.tracking.place import Array

Status = Literal["tracked", "predicted", "lost", "relocalized"]
"""How the place of a frame is known.

- tracked: the frame matches the map where it was expected, or near by.
- predicted: it does not; the place is that of the last frames, moved on.
- lost: nothing is known any more, or not yet.
- relocalized: the whole map was searched, and the frame was found.
"""
STATUSES: tuple[Status, ...] = get_args(Status)

Step = Literal["prediction", "neighbourhood", "odometry", "map", "motion"]
"""What gave the place: matches at the predicted place, around it, at the place by the motion
between frames, by the search of the whole map; or odometry alone (`odometry` of a frame that is
`predicted`) or constant velocity (`motion`)."""


@dataclass(frozen=True, eq=False)
class TrackState:
    """Where a frame lies in the map.

    Attributes:
        index: number of the frame, from 0.
        time: of the frame, in seconds.
        status: how the place is known.
        size: width and height of the frame, in pixels.
        image: name of the map image; None where the camera is lost.
        far_from_near: homography from pixels of the frame, undistorted where its camera has
            distortion, to pixels of the map image; None where the camera is lost, or the place is
            a pose.
        place: (4,) x and y of the frame's centre in pixels of the map image, natural logarithm of
            the map pixels that a frame pixel is large, and rotation in radians, clockwise. None
            where `far_from_near` is.
        covariance: (4, 4) of the place, in its units.
        confidence: probability that the place is right and exact; 0 unless the frame matches.
        expected_error: expected mean error over the frame in map pixels; None unless it matches.
        inliers: matches that agree.
        step: what gave the place.
        hypotheses: number of places that are followed.
        reason: why the frame does not match; None where it does.
        name: of the file of the frame; None for an array.
        world: place on the Earth, or pose; None where the map does not give it.
        pose_covariance: (3, 3) of the centre of the camera, for a pose.
        height: of the camera over the ground, in metres, from its focal length; None where it or
            the resolution of the map is not known.
        seconds: wall time of the update.
    """

    index: int
    time: float
    status: Status
    size: tuple[int, int]
    image: str | None = None
    far_from_near: Matrix3 | None = None
    place: Array | None = None
    covariance: Array | None = None
    confidence: float = 0.0
    expected_error: float | None = None
    inliers: int = 0
    step: Step | None = None
    hypotheses: int = 0
    reason: str | None = None
    name: str | None = None
    world: GeoPlace | QueryPose | None = None
    pose_covariance: Array | None = None
    height: float | None = None
    seconds: float = 0.0

    @property
    def known(self) -> bool:
        """Return whether the frame was matched: tracked or relocalized."""
        return self.status in ("tracked", "relocalized")

    @property
    def footprint(self) -> Coordinates | None:
        """Return the (4, 2) outline of the frame in the map image; None where it is not known."""
        if self.far_from_near is None:
            return None
        return footprint(self.far_from_near, *self.size)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as JSON values."""
        return {
            "index": self.index,
            "time": self.time,
            "name": self.name,
            "status": self.status,
            "step": self.step,
            "reason": self.reason,
            "image": self.image,
            "far_from_near": _listed(self.far_from_near),
            "size": list(self.size),
            "place": _listed(self.place),
            "covariance": _listed(self.covariance),
            "confidence": self.confidence,
            "expected_error": self.expected_error,
            "inliers": self.inliers,
            "hypotheses": self.hypotheses,
            "world": None if self.world is None else self.world.to_dict(),
            "pose_covariance": _listed(self.pose_covariance),
            "height": self.height,
            "seconds": round(self.seconds, 4),
        }

    def to_json(self) -> str:
        """Return `to_dict` as one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)

    @staticmethod
    def from_dict(content: Mapping[str, Any]) -> "TrackState":
        """Return the state that `to_dict` has written.

        Raises:
            LocalizationError: a part is missing or malformed.
        """
        try:
            if content["status"] not in STATUSES:
                raise ValueError(f"the status {content['status']!r}")
            width, height = content["size"]
            return TrackState(
                index=int(content["index"]),
                time=float(content["time"]),
                status=content["status"],
                size=(int(width), int(height)),
                image=content["image"],
                far_from_near=_array(content["far_from_near"], (3, 3)),
                place=_array(content["place"], (4,)),
                covariance=_array(content["covariance"], (4, 4)),
                confidence=float(content["confidence"]),
                expected_error=content["expected_error"],
                inliers=int(content["inliers"]),
                step=content["step"],
                hypotheses=int(content["hypotheses"]),
                reason=content["reason"],
                name=content["name"],
                world=_read_world(content["world"]),
                pose_covariance=_array(content["pose_covariance"], (3, 3)),
                height=content["height"],
                seconds=float(content["seconds"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise LocalizationError(
                f"this is no state as `TrackState.to_dict` writes it: {error!r}"
            ) from None


def _listed(array: NDArray[np.floating[Any]] | None) -> list[Any] | None:
    return None if array is None else array.tolist()


def _array(content: Any, shape: tuple[int, ...]) -> Array | None:
    if content is None:
        return None
    array = np.asarray(content, np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{shape} finite numbers are needed, not {content!r}")
    return array


def _read_world(content: Mapping[str, Any] | None) -> GeoPlace | QueryPose | None:
    if content is None:
        return None
    kind = GeoPlace if "crs" in content else QueryPose
    return kind.from_dict(content)
