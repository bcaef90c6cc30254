"""Queries of `nearfar map locate`: each is located here or by a worker, which returns text."""

import functools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nearfar.arrays import Coordinates
from nearfar.cli.map_answer import best_answer
from nearfar.cli.options import SearchOptions
from nearfar.cli.world_text import place_text
from nearfar.errors import ImageError, NearfarError, SettingsError
from nearfar.exports import Subject
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.kinds import is_video_name
from nearfar.maps import open_map
from nearfar.maps.answers import MapLocalization
from nearfar.maps.frames import VideoFrames
from nearfar.maps.images import NamedImages
from nearfar.maps.map import Map
from nearfar.maps.world.places import QueryPose
from nearfar.storage.locations import Location, local_copy, location, staged


@dataclass(frozen=True)
class Query:
    """A query and how to locate it.

    Attributes:
        source: file of the query.
        shown: what the result calls it; of a frame, the video and the time.
        name: name of the files that are saved for the query, without suffix.
        folder: folder of the map.
        search: how to search the map.
        camera: camera of the query; None where it is not known.
        save: folder for files; None saves none.
        run: id of the run; a worker opens the map once a run.
        mask: file of the query's mask; None for none.
    """

    source: Location
    shown: Location
    name: str
    folder: Location
    search: SearchOptions
    camera: CameraIntrinsics | None
    save: Location | None
    run: str
    mask: Path | None = None


@dataclass(frozen=True)
class Located:
    """The result of a query as text.

    Attributes:
        error: why the query could not be read; None where it could.
        located: whether the query was found.
        line: JSON object for `--json`.
        text: result for people to read.
        features: GeoJSON features.
        unread: why files of the map could not be read.
        subject: the best answer, to be exported; None where the query was not found.
    """

    error: str | None
    located: bool = False
    line: str = ""
    text: str = ""
    features: tuple[dict[str, Any], ...] = ()
    unread: tuple[str, ...] = ()
    subject: Subject | None = None


def given_queries(queries: Sequence[Location], listed: Path | None) -> list[Location]:
    """Return the queries that are named, with the images of folders, and those of a list.

    Args:
        queries: images, videos and folders.
        listed: file with a path on each line, relative to the file; None for none.

    Raises:
        MapError: a folder holds no images.
        SettingsError: the list cannot be read, or there is no query.
    """
    found: list[Location] = []
    for query in queries:
        inside = isinstance(query, Path) and query.is_dir()
        found += NamedImages(query).files() if inside else [query]
    if listed is not None:
        try:
            lines = listed.read_text(encoding="utf-8-sig", errors="surrogateescape").splitlines()
        except OSError as error:
            raise SettingsError(f"the list {listed} cannot be read ({error.strerror})") from None
        names = [line.strip() for line in lines]
        found += [
            location(name) if "://" in name else listed.parent / name
            for name in names
            if name and not name.startswith("#")
        ]
    if not found:
        raise SettingsError("give QUERIES, or a list of them (--list FILE)")
    return list(dict.fromkeys(found))


@contextmanager
def with_frames(
    queries: Sequence[Location], fps: float, max_pixels: int
) -> Iterator[list[tuple[Location, Location]]]:
    """Yield the file of each query and what to call it, with the frames of videos in their place.

    Raises:
        ImageError: a video cannot be decoded.
    """
    with tempfile.TemporaryDirectory() as folder:
        found: list[tuple[Location, Location]] = []
        for number, query in enumerate(queries):
            if not (isinstance(query, Path) and is_video_name(query)):
                found.append((query, query))
                continue
            frames = VideoFrames(query, Path(folder) / str(number), fps, max_pixels).files()
            found += [(each, query.with_name(f"{query.name}#t={each.stem}")) for each in frames]
        yield found


def locate_query(query: Query) -> Located:
    """Locate a query, and save its files.

    Raises:
        NearfarError: something else than the query is at fault.
    """
    map_ = _opened(query.folder, query.search, query.run)
    try:
        with local_copy(query.source) as file:
            top, candidates = query.search.top, query.search.candidates
            found = map_.locate(
                file,
                top=top,
                candidates=candidates,
                intrinsics=query.camera,
                mask=query.mask,
                prior=query.search.prior(file),
            )
    except (ImageError, FileNotFoundError) as error:
        missing = isinstance(error, FileNotFoundError)
        return Located(f"{query.source} does not exist" if missing else str(error))
    except NearfarError:
        raise
    except Exception as error:  # Libraries raise many kinds of errors for an image.
        return Located(f"{query.source}: {type(error).__name__}: {error}")
    subject = best_answer(replace(found, query=query.source), map_, query.camera)
    found = replace(found, query=query.shown)
    text = _text(found, query)
    if query.save is not None:
        with staged(query.save) as folder:
            files = [query.save / file.name for file in found.save(folder, query.name)]
        text += "".join(f"\n  saved {file}" for file in files)
    features = tuple(found.features())
    return Located(None, found.located, found.to_json(), text, features, found.unread, subject)


def died(query: Query) -> Located:
    """Return the result of a query that kills its workers."""
    return Located(f"{query.source}: the process that located it died")


@functools.lru_cache(maxsize=1)
def _opened(folder: Location, search: SearchOptions, _: str) -> Map:
    """Open the map once a process and run."""
    return open_map(folder, settings=search.settings())


def _text(found: MapLocalization, query: Query) -> str:
    top, posing = query.search.top, query.camera is not None
    if not found.located:
        places = sorted(
            ((each.image, each.place) for each in found.candidates if each.place is not None),
            key=lambda each: -(each[1].score or 0),
        )
        unverified = [
            f"  unverified: {image}: score {place.score or 0:.2f}, outline in it: "
            f"{_corners(place.footprint)}"
            for image, place in places[:top]
        ]
        return "\n".join([f"{found.query}: not found; {found.reason}", *unverified])
    lines = [f"{found.query}: located"]
    for answer in found.answers:
        lines.append(
            f"  {answer.image}: confidence {answer.confidence:.2f}, scale change "
            f"{answer.scale_change:.2f}x, {answer.votes:.1f} votes"
        )
        if answer.footprint is not None:
            lines.append(f"  outline in it: {_corners(answer.footprint)}")
        if answer.alternatives:
            count = len(answer.alternatives)
            lines.append(f"  {count} other places in it fit nearly as well (--top)")
        if answer.world is not None:
            lines.append(f"  centre: {place_text(answer.world)}")
        elif answer.taken is not None:
            place = f"latitude {answer.taken.latitude:.7f}, longitude {answer.taken.longitude:.7f}"
            lines.append(f"  taken at {place}: its place is known, but not that of the query")
    if query.search.use_gps and (found.prior is None or found.prior.source != "gps"):
        lines.append("  the query has no GPS position (--use-gps)")
    if found.pose is not None:
        lines.append(f"  {_pose_text(found.pose)}")
    elif posing:
        lines.append("  no pose: none of these map images has one (nearfar map add --help)")
    stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in found.seconds.items())
    return "\n".join([*lines, f"  {sum(found.seconds.values()):.2f} s ({stages})"])


def _corners(footprint: Coordinates) -> str:
    corners = footprint[:: len(footprint) // 4]
    return "  ".join(f"({x:.1f}, {y:.1f})" for x, y in corners)


def _pose_text(pose: QueryPose) -> str:
    basis = f"{pose.inliers} matches with {', '.join(pose.images)}"
    if pose.translation is None:
        x, y, z = pose.to_dict()["direction"]
        away = f"direction ({x:.3f}, {y:.3f}, {z:.3f}) from {pose.images[0]}"
        return f"{away}, distance unknown; {basis}"
    x, y, z = pose.translation
    return f"camera at ({x:.3f}, {y:.3f}, {z:.3f}) in {pose.world}, by {pose.source}; {basis}"
