"""A journey of `nearfar map track`: its frames are followed, printed, kept and exported."""

import math
import sys
import time as clock
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from nearfar.cli.options import BAD_INPUT, FAILED
from nearfar.cli.world_text import place_text
from nearfar.errors import SettingsError
from nearfar.imaging.video import check_rate
from nearfar.maps.map import Map
from nearfar.maps.world.places import GeoPlace, QueryPose
from nearfar.runtime.logs import say
from nearfar.tracking.constants import BUDGET
from nearfar.tracking.earth import placed_on_earth
from nearfar.tracking.exports import check_formats, export_journey
from nearfar.tracking.frames import JourneyFrame, followed, frames_of
from nearfar.tracking.journal import SMOOTH, Journal, write_states
from nearfar.tracking.picture import contact_sheet
from nearfar.tracking.pose_tracker import PoseTracker
from nearfar.tracking.run import AnyTracker, follow
from nearfar.tracking.smoothing import smoothed
from nearfar.tracking.state import STATUSES, Status, TrackState
from nearfar.tracking.tracker import Tracker

RATE_OVER = 10
"""Frames over which the rate that is shown is measured."""
SHEET = "sheet"


@dataclass(frozen=True)
class Journey:
    """What `nearfar map track` is asked for; see its options."""

    frames: tuple[Path, ...]
    follow: Path | None
    idle: float | None
    intrinsics: str | None
    fps: float | None
    budget: float | None
    as_json: bool
    save: Path | None
    export: tuple[str, ...]
    smooth: bool

    def check(self) -> None:
        """Raise a SettingsError where options do not fit each other."""
        check_rate(self.fps)
        check_formats([each for each in self.export if each != SHEET])
        if bool(self.frames) == (self.follow is not None):
            raise SettingsError("give FRAMES, or a folder that is written to (--follow FOLDER)")
        if (self.export or self.smooth) and self.save is None:
            raise SettingsError("--export and --smooth need a folder to write into (--save FOLDER)")
        if SHEET in self.export and self.follow is not None:
            raise SettingsError("--export sheet reads the frames again: give FRAMES, not --follow")

    def run(self, map_: Map) -> int:
        """Follow the frames through a map, and return the exit status.

        Raises:
            NearfarError: the input or an option is not valid.
            OSError: a file cannot be written.
        """
        self.check()
        if self.save is None:
            counted = self._followed(map_, None)
            return FAILED if counted["predicted"] or counted["lost"] else 0
        with Journal(self.save, self._identity(map_)) as journal:
            self._followed(map_, journal)
            failed = self._finished(map_, journal.states, self.save)
        for name, reason in failed.items():
            print(f"nearfar: {name}: {reason}", file=sys.stderr)  # noqa: T201
        if failed:
            return BAD_INPUT
        return 0 if all(each.known for each in journal.states) else FAILED

    def _followed(self, map_: Map, journal: Journal | None) -> Counter[str]:
        with self._tracker(map_) as tracker:
            spent = _tracked(tracker, self._read(map_), journal, as_json=self.as_json)
        if spent:
            say(_costs(spent))
        return Counter({status: len(times) for status, times in spent.items()})

    def _tracker(self, map_: Map) -> AnyTracker:
        """Return a tracker of poses where the map and the camera give them, else of places."""
        live = BUDGET if self.follow is not None else math.inf
        budget = live if self.budget is None else self.budget
        if self.intrinsics is None or len(map_.posed) < 2:
            return Tracker(map_, intrinsics=self.intrinsics, budget=budget)
        return PoseTracker(map_, intrinsics=self.intrinsics, budget=budget)

    def _read(self, map_: Map) -> Iterator[JourneyFrame]:
        if self.follow is not None:
            return followed(self.follow, self.fps, self.idle)
        return frames_of(self.frames, self.fps, map_.settings.max_pixels)

    def _identity(self, map_: Map) -> dict[str, object]:
        """Return what the states depend on, so that another run does not go on with them."""
        return {
            "map": str(map_.folder),
            "frames": [str(each) for each in self.frames],
            "follow": None if self.follow is None else str(self.follow),
            "intrinsics": self.intrinsics,
            "fps": self.fps,
        }

    def _finished(self, map_: Map, states: list[TrackState], folder: Path) -> dict[str, str]:
        """Write the smooth path and the exports; return why a format was not written."""
        if self.smooth:
            states = placed_on_earth(smoothed(states), map_.folder, self.intrinsics)
            write_states(folder / SMOOTH, states)
        named = [each for each in self.export if each != SHEET]
        failed = export_journey(map_, states, named, folder)
        if SHEET in self.export:
            contact_sheet(map_, states, self._read(map_), folder)
        return failed


def _tracked(
    tracker: AnyTracker, frames: Iterator[JourneyFrame], journal: Journal | None, *, as_json: bool
) -> dict[Status, list[float]]:
    """Print a line for each frame, and how fast it goes; return the seconds of each by status."""
    spent: dict[Status, list[float]] = {}
    live = sys.stderr.isatty() and not sys.stdout.isatty()
    begun = [clock.monotonic()]
    for state in follow(tracker, frames, journal):
        spent.setdefault(state.status, []).append(state.seconds)
        begun = [*begun[-RATE_OVER:], clock.monotonic()]
        rate = (len(begun) - 1) / max(1e-9, begun[-1] - begun[0])
        text = _text(state, rate)
        sys.stdout.write((state.to_json() if as_json else text) + "\n")
        sys.stdout.flush()
        if live:
            after = "" if state.known else _waiting(tracker.budget)
            sys.stderr.write(f"\r\033[K{text}{after}")
            sys.stderr.flush()
    if live:
        sys.stderr.write("\r\033[K")
    return spent


def _waiting(budget: float) -> str:
    """Return what a lost frame may cost."""
    if math.isfinite(budget):
        return f" (a search may take {budget:g} s a frame)"
    return " (a search of the whole map takes seconds; --budget bounds it)"


def _costs(spent: dict[Status, list[float]]) -> str:
    """Return how many frames had each status, and what one of them took."""
    parts = [
        f"{len(spent[status])} {status} ({sum(spent[status]) / len(spent[status]):.2f} s each)"
        for status in STATUSES
        if status in spent
    ]
    return f"{sum(map(len, spent.values()))} frames: {', '.join(parts)}"


def _text(state: TrackState, rate: float) -> str:
    """Return a line for people to read."""
    parts = [f"{state.name}: {state.status}"]
    if state.place is not None and state.covariance is not None:
        spread = float((state.covariance[0, 0] + state.covariance[1, 1]) / 2) ** 0.5
        x, y = state.place[:2]
        parts.append(f"({x:.1f}, {y:.1f}) ± {spread:.1f} in {state.image}")
    if isinstance(state.world, GeoPlace):
        parts.append(place_text(state.world))
    if isinstance(state.world, QueryPose) and state.world.translation is not None:
        x, y, z = state.world.translation
        parts.append(f"camera at ({x:.2f}, {y:.2f}, {z:.2f}) in {state.world.world}")
    if state.height is not None:
        parts.append(f"{state.height:.1f} m over the ground")
    parts.append(f"confidence {state.confidence:.2f}" if state.known else str(state.reason))
    if not state.known:
        parts.append(f"{state.seconds:.1f} s")
    return f"{'; '.join(parts)}; {rate:.1f} frames/s"
