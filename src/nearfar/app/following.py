"""The work on tracks in a worker process: follow a camera, and write its path in other formats."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path

from nearfar.app.cameras import camera_of_frames
from nearfar.app.library import frame_files
from nearfar.app.process import Ended, FrameReport, Message, Outcome, StageReport
from nearfar.app.reasons import in_plain_words
from nearfar.app.track_tasks import ExportTrack, FollowFrames
from nearfar.errors import ExportError, LocalizationError, MapError, NearfarError
from nearfar.imaging.kinds import is_video_name
from nearfar.maps import DEFAULTS, open_map
from nearfar.maps.map import Map
from nearfar.storage.locations import Location
from nearfar.storage.rows import read_rows
from nearfar.tracking import PoseTracker, Tracker
from nearfar.tracking.earth import placed_on_earth
from nearfar.tracking.exports import FORMATS, export_journey
from nearfar.tracking.frames import JourneyFrame, frames_of
from nearfar.tracking.journal import SMOOTH, Journal, write_states
from nearfar.tracking.picture import contact_sheet
from nearfar.tracking.run import follow
from nearfar.tracking.smoothing import smoothed
from nearfar.tracking.state import TrackState

SHEET = "sheet"
"""Name of the format that is a contact sheet."""
SHEET_FILE = "track-sheet.png"
PICTURES = ("png", SHEET)
"""Formats that read images; where only the outcomes are wanted, they are not written."""


def followed(task: FollowFrames, send: Callable[[Message], None]) -> Ended:
    """Follow a camera, and keep the state of each frame as it is known.

    Raises:
        NearfarError: the map, the frames or the camera cannot be read.
        OSError: the states cannot be written.
    """
    camera = camera_of_frames(task.camera)
    files, total = _frames_in(task)
    send(StageReport(stage="describing the far image" if task.far.is_file() else "opening the map"))
    map_ = _map_of(task)
    run = {
        "map": str(map_.folder),
        "frames": [str(task.frames)],
        "follow": None,
        "intrinsics": task.camera,
        "fps": task.fps,
    }
    send(StageReport(stage="following the camera"))
    posed = camera is not None and len(map_.posed) > 1
    kind = PoseTracker if posed else Tracker
    with (
        Journal(task.folder, run) as journal,
        kind(map_, intrinsics=camera, budget=math.inf) as tracker,  # type: ignore[arg-type]
    ):
        counts = _Counts(total)
        for state in journal.states:
            counts.add(state)
        for state in follow(
            tracker, _limited(frames_of(files, task.fps, task.max_pixels), task), journal
        ):
            send(counts.add(state))
        states = journal.states
    if task.smooth:
        send(StageReport(stage="smoothing the path"))
        write_states(task.folder / SMOOTH, placed_on_earth(smoothed(states), map_.folder, camera))
    found = sum(each.known for each in states)
    return Ended(summary=f"{found} of {len(states)} frames found", found=found > 0)


class _Counts:
    """Counts frames by what is known of them."""

    def __init__(self, total: int | None) -> None:
        self._total = total
        self._done = self._found = self._lost = 0

    def add(self, state: TrackState) -> FrameReport:
        """Count a frame, and return how things stand."""
        self._done += 1
        self._found += state.known
        self._lost += state.status == "lost"
        return FrameReport(done=self._done, total=self._total, found=self._found, lost=self._lost)


def _frames_in(task: FollowFrames) -> tuple[list[Path], int | None]:
    """Return the files of the frames, or the video, and the number of frames if it is known."""
    if not task.frames.is_dir():
        if not is_video_name(task.frames):
            raise MapError("the frames are neither a folder nor a video: choose one of them")
        return [task.frames], None
    files = frame_files(task.frames)
    if not files:
        raise MapError("the folder has no images to follow: choose another one")
    if len(files) > task.most_frames:
        raise MapError(
            f"the folder has {len(files)} images, and at most {task.most_frames} are followed: "
            "use nearfar map track"
        )
    return files, len(files)


def _limited(frames: Iterator[JourneyFrame], task: FollowFrames) -> Iterator[JourneyFrame]:
    yield from islice(frames, task.most_frames)
    if next(frames, None) is not None:
        raise MapError(
            f"the video has more than {task.most_frames} frames: take fewer a second, or use "
            "nearfar map track"
        )


def _map_of(task: FollowFrames) -> Map:
    """Return the map: the one that is asked for, or a new one of the far image alone."""
    settings = DEFAULTS.replace(max_pixels=task.max_pixels)
    if task.far.is_dir():
        map_ = open_map(task.far, settings=settings)
        check_served(map_, task.served)
        return map_
    map_ = open_map(task.folder.parent / "map", create=True, settings=settings)
    for _, reason in map_.add([task.far]).failed:
        raise MapError(reason)
    return map_


def check_served(map_: Map, served: tuple[Path, ...]) -> None:
    """Raise a MapError where an image of a map lies outside the served folders."""
    from nearfar.maps.files import file_of

    for image in map_.images:
        if not _is_served(file_of(image.name, map_.folder), served):
            raise MapError(
                "the map names images outside the folders that the app serves: start it with the "
                "folder of the photographs as well"
            )


def _is_served(file: Location, served: tuple[Path, ...]) -> bool:
    """Whether a file lies in a served folder, links followed."""
    return isinstance(file, Path) and any(
        file.resolve().is_relative_to(folder) for folder in served
    )


def exported_track(task: ExportTrack) -> list[Outcome]:
    """Write a track in each format, or say why a format cannot be written.

    Raises:
        NearfarError: the file of the states or the map cannot be read.
    """
    states = []
    for row in read_rows(task.states):
        with suppress(LocalizationError):  # The page tells that damaged lines are left out.
            states.append(TrackState.from_dict(row))
    if not task.formats:
        written = [_outcome(each, states, None, task) for each in FORMATS if each not in PICTURES]
        reasons = {"png": _no_path(states, task), SHEET: _no_sheet(states, task)}
        pictures = (
            Outcome(format=each, file=_file(each), reason=reasons[each]) for each in PICTURES
        )
        return [*written, *pictures]
    map_ = None
    if task.map_folder is not None and set(task.formats) & set(PICTURES):
        map_ = open_map(task.map_folder, settings=DEFAULTS.replace(max_pixels=task.max_pixels))
        if task.served:
            check_served(map_, task.served)
    return [_outcome(each, states, map_, task) for each in task.formats]


def _file(name: str) -> str:
    return SHEET_FILE if name == SHEET else FORMATS[name][0]


def _no_path(states: Sequence[TrackState], task: ExportTrack) -> str | None:
    """Return why no picture of the path can be drawn; None where it can."""
    if task.map_folder is None:
        return "the map is elsewhere: start nearfar app with its folder as well"
    if not any(each.place is not None or each.world is not None for each in states):
        return "no frame has a place"
    return None


def _no_sheet(states: Sequence[TrackState], task: ExportTrack) -> str | None:
    """Return why no contact sheet can be drawn; None where it can."""
    if not any(each.footprint is not None for each in states):
        return "no frame has an outline in a map image"
    if not task.frames:
        return "the frames are elsewhere: start nearfar app with their folder as well"
    return _no_path(states, task)


def _outcome(name: str, states: list[TrackState], map_: Map | None, task: ExportTrack) -> Outcome:
    if name not in (*FORMATS, SHEET):
        raise ExportError(f"there is no format {name!r} of a track")
    try:
        if name == SHEET:
            reason = _no_sheet(states, task)
            if reason is None and map_ is not None:
                frames = frames_of(_frame_sources(task), task.fps, task.max_pixels)
                contact_sheet(map_, states, frames, task.folder)
        else:
            reason = export_journey(map_, states, [name], task.folder).get(name)
    except (NearfarError, OSError) as error:
        reason = str(error)
    written = (task.folder / _file(name)).is_file()
    if reason is None and not written:
        reason = "nothing could be drawn: the frames cannot be read"
    return Outcome(
        format=name,
        file=_file(name),
        files=(_file(name),) if written else (),
        reason=reason and in_plain_words(reason),
    )


def _frame_sources(task: ExportTrack) -> list[Path]:
    """Return the files of the frames in their order."""
    return [
        file for each in task.frames for file in (frame_files(each) if each.is_dir() else [each])
    ]
