"""The states of a track as they are kept in a file, which anybody may have written."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from nearfar.app.configuration import MEGABYTE
from nearfar.app.errors import TooLargeError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Row3 = tuple[Finite, Finite, Finite]
Status = Literal["tracked", "relocalized", "predicted", "lost"]


class _Read(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class _Outline(_Read):
    centre: tuple[Finite, Finite]


class KeptPose(_Read):
    """Orientation and position of a camera in the world."""

    rotation: tuple[Row3, Row3, Row3]
    translation: Row3 | None


class _World(_Read):
    """The part of a place on the Earth, or of a pose, that is shown."""

    longitude_latitude: _Outline | None = None
    heading: Finite | None = None
    resolution: Finite | None = None
    error: Finite | None = None
    world_from_query: KeptPose | None = None


class KeptState(_Read):
    """The part of a `nearfar.tracking.TrackState` that is shown; see there."""

    index: int = Field(ge=0)
    time: Finite
    status: Status
    size: tuple[int, int]
    name: Annotated[str, Field(max_length=4000)] | None = None
    image: Annotated[str, Field(max_length=4000)] | None = None
    far_from_near: tuple[Row3, Row3, Row3] | None = None
    place: tuple[Finite, Finite, Finite, Finite] | None = None
    confidence: Finite = 0.0
    expected_error: Finite | None = None
    inliers: int = 0
    step: Annotated[str, Field(max_length=40)] | None = None
    reason: Annotated[str, Field(max_length=4000)] | None = None
    world: _World | None = None
    height: Finite | None = None


def read_states(file: Path, most_bytes: int) -> tuple[list[KeptState], int]:
    """Return the states in a file, and the number of its lines that are damaged.

    Raises:
        TooLargeError: the file is larger than `most_bytes`.
    """
    if file.stat().st_size > most_bytes:
        raise TooLargeError(f"the track is larger than {most_bytes // MEGABYTE} megabytes")
    states, skipped = [], 0
    with file.open("rb") as lines:
        for line in lines:
            if not line.endswith(b"\n"):
                break  # It is being written.
            try:
                states.append(KeptState.model_validate_json(line))
            except ValidationError:
                skipped += 1
    return states, skipped


def pose_of(state: KeptState) -> KeptPose | None:
    """Return the pose of a state; None unless it has one with a position."""
    pose = None if state.world is None else state.world.world_from_query
    return pose if pose is not None and pose.translation is not None else None
