"""Follow a camera through the frames of a journey, and go on where a run was stopped."""

from collections.abc import Iterable, Iterator
from itertools import chain

from nearfar.errors import ImageError
from nearfar.tracking.frames import JourneyFrame
from nearfar.tracking.journal import Journal
from nearfar.tracking.pose_tracker import PoseTracker
from nearfar.tracking.state import TrackState
from nearfar.tracking.tracker import Tracker

AnyTracker = Tracker | PoseTracker


def follow(
    tracker: AnyTracker, frames: Iterable[JourneyFrame], journal: Journal | None = None
) -> Iterator[TrackState]:
    """Yield the state of each frame that the journal lacks.

    Args:
        tracker: a new tracker.
        frames: all frames of the journey, also those that the journal has.
        journal: gets the states, and has those of an earlier run; None for none.

    Raises:
        MapError: a file of the map is missing or has changed.
        OSError: the journal cannot be written.
        SettingsError: the times of the frames do not rise.
    """
    remaining = iter(frames)
    if journal is not None and journal.checkpoint is not None:
        remaining = _resumed(tracker, remaining, journal.checkpoint)
    for frame in remaining:
        state = _state_of(tracker, frame)
        if journal is not None:
            journal.add(state, tracker.checkpoint())
        yield state


def _state_of(tracker: AnyTracker, frame: JourneyFrame) -> TrackState:
    """Return the state of a frame; of one that cannot be read, the predicted one."""
    try:
        return tracker.update(frame.image, frame.time, name=frame.name)
    except ImageError as error:
        return tracker.skip(str(error), frame.time, name=frame.name)


def _resumed(
    tracker: AnyTracker, frames: Iterator[JourneyFrame], checkpoint: dict[str, object]
) -> Iterator[JourneyFrame]:
    """Bring a tracker to a checkpoint, and return the frames after it."""
    last, anchor = checkpoint["index"], checkpoint["anchor"]
    found: JourneyFrame | None = None
    for frame in frames:
        if frame.index == anchor:
            found = frame
        if frame.index == last:
            break
    tracker.restore(checkpoint, None if found is None else found.image)
    return chain(frames)
