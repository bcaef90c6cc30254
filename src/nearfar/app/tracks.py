"""Tracks for the page: the states of frames, where their pictures are, and the view from above.

A track lies in a folder as `nearfar map track --save` writes it: of a job, or of an earlier run
in a served folder. What is read here may have been written by anybody.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np

from nearfar.app.configuration import MEGABYTE
from nearfar.app.errors import ConflictError, NotFoundError
from nearfar.app.library import TRACK_FILE, Library
from nearfar.app.track_states import KeptState, Status, pose_of, read_states
from nearfar.geometry.homography import footprint
from nearfar.geometry.plan_view import plan_of
from nearfar.imaging.kinds import is_video_name

SMOOTH_FILE, RUN_FILE = "track-smooth.jsonl", "checkpoint.json"
LARGEST_RUN = 4 * MEGABYTE
"""Largest size of a checkpoint that is read."""


@dataclass(frozen=True)
class TrackFrame:
    """A frame of a track.

    Attributes:
        index: number of the frame, from 0.
        time: in seconds.
        name: of its file, or of the video and the time.
        status: how its place is known; see `nearfar.tracking.state.Status`.
        confidence: probability that the place is right and exact; 0 unless it matches.
        error: expected mean error in map pixels; None unless it matches.
        inliers: matches that agree.
        step: what gave the place.
        reason: why it does not match; None where it does.
        image: number of its map image; None where it has none.
        place: centre in pixels of the map image or, of a pose, in units of the world as seen from
            above; None where it is not known.
        outline: corners in the map image; None where they are not known.
        looks: direction to which the camera looks as seen from above, for a pose.
        centre: position of the camera in the world, for a pose.
        degrees: longitude and latitude of the centre; None where they are not known.
        heading: degrees clockwise from north of the upper edge; None where it is not known.
        height: over the ground in metres; None where it is not known.
        source: number of the source of its picture; None where it is not served.
    """

    index: int
    time: float
    name: str
    status: Status
    confidence: float
    error: float | None
    inliers: int
    step: str | None
    reason: str | None
    image: int | None
    place: tuple[float, ...] | None
    outline: list[list[float]] | None
    looks: tuple[float, ...] | None
    centre: tuple[float, ...] | None
    degrees: tuple[float, ...] | None
    heading: float | None
    height: float | None
    source: int | None


@dataclass(frozen=True)
class TrackSource:
    """Where pictures of frames are: a video, or a folder or file of images."""

    ref: str
    kind: Literal["video", "folder", "image"]


@dataclass(frozen=True)
class TrackImage:
    """A map image; its reference is None where it is not served."""

    name: str
    ref: str | None


@dataclass(frozen=True)
class Track:
    """A camera that was followed.

    Attributes:
        name: name of the track.
        frames: its frames from `start` on.
        start: number of frames before.
        total: number of frames so far.
        images: the map images that frames lie in.
        sources: where the pictures of the frames are.
        plan: names of the axes to the right and to the upper edge, of a track of poses as seen from
            above; None of one in map images.
        smooth: whether there is a smoothed path.
        skipped: lines that could not be read.
    """

    name: str
    frames: list[TrackFrame]
    start: int
    total: int
    images: list[TrackImage]
    sources: list[TrackSource]
    plan: tuple[str, str] | None
    smooth: bool
    skipped: int


@dataclass(frozen=True)
class TrackPlaces:
    """Where the parts of a track are.

    Attributes:
        folder: folder of its states.
        name: name to show.
        sources: where the pictures of its frames are.
        image_ref: returns the reference of a map image by its name; None where it is not served.
        map_folder: folder of the map; None where it is not served.
        trusted_map: whether the app made the map itself.
        fps: see `nearfar.tracking.frames.frames_of`.
    """

    folder: Path
    name: str
    sources: tuple[TrackSource, ...]
    image_ref: Callable[[str], str | None]
    map_folder: Path | None
    trusted_map: bool
    fps: float | None

    def file(self, *, smooth: bool) -> Path:
        """Return the file of the states.

        Raises:
            NotFoundError: there is none.
            ConflictError: it is a link.
        """
        file = self.folder / (SMOOTH_FILE if smooth else TRACK_FILE)
        if file.is_symlink():
            raise ConflictError(f"{file.name} is a link, which the app does not follow")
        if not file.is_file():
            raise NotFoundError("no frame of this track is known")
        return file


def saved_places(folder: Path, library: Library) -> TrackPlaces:
    """Return where the parts of a track are that `nearfar map track` has written.

    Paths in its checkpoint count only where they lead into served folders.

    Raises:
        ConflictError: its checkpoint is a link.
    """
    run = _run_of(folder)
    map_folder = _served_place(str(run.get("map") or ""), folder, library)
    given = run.get("frames")
    listed = [run["follow"]] if isinstance(run.get("follow"), str) else given
    sources = []
    for each in listed if isinstance(listed, list) else []:
        place = _served_place(str(each), folder, library)
        ref = None if place is None else library.reference(place)
        if place is not None and ref is not None:
            sources.append(source_of(ref, place))
    fps = run.get("fps")
    return TrackPlaces(
        folder,
        folder.name,
        tuple(sources),
        refs_in_map(map_folder, library),
        map_folder,
        trusted_map=False,
        fps=float(fps) if isinstance(fps, int | float) and 0 < fps <= 1000 else None,
    )


def source_of(ref: str, place: Path) -> TrackSource:
    """Return the source of frames at a place, by its reference."""
    if place.is_dir():
        return TrackSource(ref, "folder")
    return TrackSource(ref, "video" if is_video_name(place) else "image")


def refs_in_map(map_folder: Path | None, library: Library) -> Callable[[str], str | None]:
    """Return what gives the reference of a map image by its name; None where it is not served."""

    def ref(name: str) -> str | None:
        if map_folder is None or "://" in name or "\0" in name:
            return None
        file = Path(os.path.normpath(map_folder.resolve().parent / name))
        found = library.reference(file)
        return found if found is not None and file.is_file() else None

    return ref


def _run_of(folder: Path) -> Mapping[str, Any]:
    """Return what a run depended on, as its checkpoint says; nothing where it says nothing."""
    file = folder / RUN_FILE
    if file.is_symlink():
        raise ConflictError(f"{file.name} is a link, which the app does not follow")
    try:
        if file.stat().st_size > LARGEST_RUN:
            return {}
        run = json.loads(file.read_text(encoding="utf-8"))["run"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}
    return run if isinstance(run, dict) else {}


def _served_place(path: str, folder: Path, library: Library) -> Path | None:
    """Return a place that a checkpoint names, relative to one of three folders, if it is served."""
    if not path or "\0" in path or len(path) > 4000:
        return None
    for place in (Path(path), folder / path, folder.parent / path):
        if library.reference(place) is not None and os.path.exists(place):  # noqa: PTH110
            return place.resolve()
    return None


def read_track(
    places: TrackPlaces, library: Library, *, smooth: bool, start: int, most_bytes: int
) -> Track:
    """Return a track from one of its frames on.

    Raises:
        NotFoundError: there are no states.
        ConflictError: the file of the states is a link.
        TooLargeError: it is larger than `most_bytes`.
    """
    states, skipped = read_states(places.file(smooth=smooth), most_bytes)
    names = dict.fromkeys(each.image for each in states if each.image and each.far_from_near)
    images = [TrackImage(PurePosixPath(name).name, places.image_ref(name)) for name in names]
    numbers = {name: k for k, name in enumerate(names)}
    posed = [each for each in states if not images and pose_of(each) is not None]
    plan = None
    axes: tuple[int, int] | None = None
    if posed:
        poses = [pose for each in posed if (pose := pose_of(each)) is not None]
        found = plan_of(
            np.array([pose.translation for pose in poses]),
            np.array([pose.rotation for pose in poses]),
        )
        plan, axes = found.names, (found.right, found.up)
    pictures = _Pictures(places.sources, library)
    return Track(
        name=places.name,
        frames=[_frame(each, numbers, axes, pictures) for each in states[start:]],
        start=start,
        total=len(states),
        images=images,
        sources=list(places.sources),
        plan=plan,
        smooth=(places.folder / SMOOTH_FILE).is_file(),
        skipped=skipped,
    )


class _Pictures:
    """Finds which source has the picture of a frame.

    Attributes:
        library: the served folders.
    """

    def __init__(self, sources: Sequence[TrackSource], library: Library) -> None:
        self.library = library
        self._videos = [k for k, each in enumerate(sources) if each.kind == "video"]
        self._folders = [
            (k, library.folder(each.ref)) for k, each in enumerate(sources) if each.kind == "folder"
        ]
        self._files = {
            each.ref.rpartition("/")[2]: k for k, each in enumerate(sources) if each.kind == "image"
        }

    def source(self, name: str) -> int | None:
        """Return the number of the source that has a frame's picture."""
        if "#t=" in name and self._videos:
            return self._videos[0]
        if not name or "/" in name or "\0" in name:
            return None
        for number, folder in self._folders:
            if os.path.isfile(folder / name):  # noqa: PTH113 - takes any name, however long
                return number
        return self._files.get(name)


def _frame(
    state: KeptState, images: Mapping[str, int], axes: tuple[int, int] | None, pictures: _Pictures
) -> TrackFrame:
    outline = None
    if state.far_from_near is not None:
        corners = footprint(np.array(state.far_from_near), *state.size)
        outline = None if corners is None else np.round(corners, 2).tolist()
    pose, world = pose_of(state), state.world
    centre = None if pose is None else pose.translation
    place = None if state.place is None else state.place[:2]
    looks = None
    if axes is not None:
        place = None if centre is None else (centre[axes[0]], centre[axes[1]])
        looks = None if pose is None else (pose.rotation[axes[0]][2], pose.rotation[axes[1]][2])
    on_earth = None if world is None else world.longitude_latitude
    return TrackFrame(
        index=state.index,
        time=state.time,
        name=state.name or str(state.index),
        status=state.status,
        confidence=state.confidence,
        error=state.expected_error,
        inliers=state.inliers,
        step=state.step,
        reason=state.reason and pictures.library.without_places(state.reason),
        image=images.get(state.image or "") if outline is not None else None,
        place=place,
        outline=outline,
        looks=looks,
        centre=centre,
        degrees=None if on_earth is None else on_earth.centre,
        heading=None if world is None else world.heading,
        height=state.height,
        source=pictures.source(state.name or ""),
    )
