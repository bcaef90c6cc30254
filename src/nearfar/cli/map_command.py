"""The commands of `nearfar map`."""

import json
import sys
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from nearfar.batch.pairs import distinct_names
from nearfar.cli.options import (
    BAD_INPUT,
    DEFAULT_SEARCH,
    DEFAULT_WORK,
    FAILED,
    NO_WORLD,
    CameraOption,
    Flag,
    Place,
    SearchOptions,
    WeightOptions,
    WorkOptions,
    WorldOptions,
    with_weights,
)
from nearfar.errors import SettingsError
from nearfar.geometry.camera_files import read_camera
from nearfar.imaging.kinds import is_video_name
from nearfar.imaging.mask_folder import MaskFolder
from nearfar.imaging.video import check_rate
from nearfar.maps import DEFAULTS, PACKAGES, open_map
from nearfar.runtime import logs, require
from nearfar.runtime.logs import shown_progress
from nearfar.runtime.timing import Meter
from nearfar.settings import Settings
from nearfar.storage.locations import Location

map_app = App(name="map", help="Keep a map of many images, and locate other images in it.")

MapFolder = Annotated[Place, Parameter(name="MAP")]
AsJson = Annotated[Flag, Parameter(name="--json")]


@map_app.command(name="build")
def build_command(
    images: list[Place],
    /,
    *,
    out: Place,
    masks: Path | None = None,
    max_size: int | None = None,
    max_pixels: int = DEFAULTS.max_pixels,
    bands: str = "",
    fps: float = 1.0,
    weights: WeightOptions = (),
    work: WorkOptions = DEFAULT_WORK,
    world: WorldOptions = NO_WORLD,
) -> None:
    """Make a map of IMAGES, or complete one.

    Images that are already in the map and have not changed are skipped. Images that have changed
    are replaced. A build that was stopped is resumed.

    Args:
        images: Image files, folders whose images are added, patterns such as 'photos/*.jpg', or
            URLs.
        out: Folder of the map, or its URL (s3://BUCKET/PATH).
        masks: Folder of masks in COLMAP's naming. The image at PATH below its folder in IMAGES has
            the mask PATH.png. A mask is as large as its image, and black where it must not be used.
        max_size: Longest side in pixels to which images are reduced; by default they are not.
        max_pixels: Skip images with more pixels, which may be decompression bombs.
        bands: Bands of the images to show as red, green and blue, such as 4,3,2. One band is shown
            as grey. By default, each file names its colours.
        fps: Frames to take a second of videos among IMAGES. They are written beside the map, into
            MAP-frames, as files that are named by their time.
        weights: File of another model of the descriptor, as nearfar=FILE.
    """
    settings = with_weights(DEFAULTS.replace(max_pixels=max_pixels, bands=bands), weights)
    _add(out, images, settings, work, world, masks=masks, fps=fps, create=True, max_size=max_size)


@map_app.command(name="add")
def add_command(
    folder: MapFolder,
    images: list[Place],
    /,
    *,
    masks: Path | None = None,
    max_pixels: int = DEFAULTS.max_pixels,
    fps: float = 1.0,
    weights: WeightOptions = (),
    work: WorkOptions = DEFAULT_WORK,
    world: WorldOptions = NO_WORLD,
) -> None:
    """Add IMAGES to a map that exists.

    Args:
        folder: Folder of the map.
        images: Image files, folders whose images are added, patterns such as 'photos/*.jpg', or
            URLs.
        masks: Folder of masks in COLMAP's naming. The image at PATH below its folder in IMAGES has
            the mask PATH.png. A mask is as large as its image, and black where it must not be used.
        max_pixels: Skip images with more pixels, which may be decompression bombs.
        fps: Frames to take a second of videos among IMAGES.
        weights: File of another model of the descriptor, as nearfar=FILE.
    """
    settings = with_weights(DEFAULTS.replace(max_pixels=max_pixels), weights)
    _add(folder, images, settings, work, world, masks=masks, fps=fps)


@map_app.command(name="remove")
def remove_command(folder: MapFolder, names: list[str], /) -> None:
    """Remove images from a map; their files are kept.

    Args:
        folder: Folder of the map.
        names: Names as `nearfar map info` shows them, or paths.
    """
    _say(f"{open_map(folder).remove(names)} removed")


@map_app.command(name="info")
def info_command(folder: MapFolder, /, *, as_json: AsJson = False) -> None:
    """Print what is in a map.

    Args:
        folder: Folder of the map.
        as_json: Print one JSON object instead of text.
    """
    map_ = open_map(folder)
    images, made, posed = map_.images, asdict(map_.manifest), map_.posed
    if as_json:
        rows = [{**asdict(each), "pose": each.id in posed} for each in images]
        _say(json.dumps({"map": str(folder), **made, "images": rows}))
        return
    landmarks = sum(image.landmarks for image in images)
    known = sum(image.id in posed for image in images)
    _say(f"{len(images)} images, {landmarks} landmarks, {known} poses")
    _say(", ".join(f"{name.replace('_', ' ')} {value}" for name, value in made.items()))
    for image in images:
        size = f"{image.width}x{image.height}, {image.landmarks} landmarks"
        pose = ", pose" if image.id in posed else ""
        _say(f"{image.name}: {size if image.usable else image.status}{pose}")


@map_app.command(name="check")
def check_command(folder: MapFolder, /, *, content: Flag = False) -> int:
    """Check a map and the files of its images.

    Each problem is one line. Exit status: 0 no problem, 3 problems, 2 bad input or usage.

    Args:
        folder: Folder of the map.
        content: Also read the files whose size and time have not changed.
    """
    map_ = open_map(folder)
    problems = map_.check(content=content)
    for problem in problems:
        _say(f"{problem.image or folder}: {problem.what}")
    if not problems:
        _say(f"{len(map_.images)} images, no problem")
    return FAILED if problems else 0


@map_app.command(name="upgrade")
def upgrade_command(folder: MapFolder, /) -> None:
    """Bring a map of an older version to the present format, without reading its images again.

    Args:
        folder: Folder of the map.
    """
    require("map", *PACKAGES)
    from nearfar.maps.creation import upgrade

    before, after = upgrade(folder)
    _say(f"format {before} -> {after}" if before != after else f"format {after} already")


@map_app.command(name="unlock")
def unlock_command(folder: MapFolder, /) -> None:
    """Remove the lock of a process that was killed while it wrote to a map in object storage.

    First make sure that the process has ended. Two writers can leave images without
    landmarks, which `nearfar map check` reports.

    Args:
        folder: URL of the map.
    """
    require("map", *PACKAGES)
    from nearfar.maps.database import unlock

    owner = unlock(folder)
    _say("there was no lock" if owner is None else f"removed the lock of {owner}")


@map_app.command(name="compact")
def compact_command(folder: MapFolder, /) -> None:
    """Merge the files of a map, remove old ones, and index the landmarks of a large map.

    Args:
        folder: Folder of the map.
    """
    indexed = open_map(folder).compact()
    _say("compacted; landmarks are indexed" if indexed else "compacted")


@map_app.command(name="locate")
def locate_command(
    folder: MapFolder,
    queries: list[Place] = [],  # noqa: B006
    /,
    *,
    listed: Annotated[Path | None, Parameter(name="--list")] = None,
    as_json: AsJson = False,
    save: Place | None = None,
    geojson: Path | None = None,
    export: Annotated[
        tuple[str, ...], Parameter(negative="", metavar="FORMAT", show_default=False)
    ] = (),
    dem: Path | None = None,
    intrinsics: CameraOption = None,
    masks: Path | None = None,
    fps: float = 1.0,
    search: SearchOptions = DEFAULT_SEARCH,
    work: WorkOptions = DEFAULT_WORK,
) -> int:
    """Find where QUERIES lie in a map.

    Exit status: 0 all located, 3 some not found, 2 bad input or usage, or not found while files of
    the map are missing.

    Args:
        folder: Folder of the map.
        queries: Images, videos or folders of images to locate, or URLs of images.
        listed: File with a query on each line. Paths are relative to it.
        as_json: Print one JSON object a line for each query instead of text.
        save: Folder or URL for a JSON file and a picture of each query.
        geojson: File for the footprints of all queries in georeferenced images, in longitude and
            latitude.
        export: Write files for another tool into the folder of --save, as nearfar localize does;
            may be repeated. Of odm and geopackage, one file has all queries. Of others, each query
            has its own.
        dem: Raster of heights in metres, for the heights of --export odm.
        intrinsics: Camera that took the queries, as for nearfar localize, or a JSON file
            {"query": [fx, fy, cx, cy]}. Its distortion is undone. In a map with poses it gives the
            poses of the queries.
        masks: Folder of masks of the queries. A query whose file is NAME has the mask NAME.png. A
            mask is as large as its query, and black where it must not be used.
        fps: Frames to locate a second of videos.
    """
    check_rate(fps)
    if geojson is not None and not geojson.parent.is_dir():
        raise SettingsError(f"there is no folder {geojson.parent} for --geojson")
    open_map(folder, settings=search.settings())
    from nearfar.cli.map_exports import map_exports
    from nearfar.cli.map_queries import Query, died, given_queries, locate_query, with_frames

    exports = map_exports(export, save, dem)
    camera = None if intrinsics is None else read_camera(intrinsics, "query")
    folder_of_masks = None if masks is None else MaskFolder.opened(masks)
    run, workers, meter = uuid.uuid4().hex, work.begin("map"), Meter()
    located = []
    with (
        with_frames(given_queries(queries, listed), fps, search.max_pixels) as given,
        shown_progress("queries") as show,
    ):
        tasks = [
            Query(
                query,
                shown,
                name,
                folder,
                search,
                camera,
                save,
                run,
                _mask_of(query, folder_of_masks),
            )
            for (query, shown), name in zip(
                given, distinct_names([each[1] for each in given]), strict=True
            )
        ]
        for found in workers.run_in_order(locate_query, tasks, died, meter):
            show(meter.done, len(tasks))
            if found.error is None:
                _say(found.line if as_json else found.text)
            _complain([] if found.error is None else [found.error])
            _complain(found.unread)
            meter.failed += found.error is not None or bool(found.unread and not found.located)
            located.append(found)
        if exports is not None:
            named = zip(tasks, located, strict=True)
            subjects = [(each.name, found.subject) for each, found in named if found.subject]
            exported = exports.write(subjects)
            _complain(exported.failed)
            meter.failed += len(exported.failed)
            for file in () if as_json else exported.files:
                _say(f"saved {file}")
    if geojson is not None:
        features = [feature for found in located for feature in found.features]
        content = {"type": "FeatureCollection", "features": features}
        geojson.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")
    logs.event("queries located", map=str(folder), **meter.metrics().to_dict())
    if meter.failed:
        return BAD_INPUT
    return 0 if all(found.located for found in located) else FAILED


def _mask_of(query: Location, masks: MaskFolder | None) -> Path | None:
    return None if masks is None else masks.mask_of(query.name)


def _add(
    folder: Location,
    images: Sequence[Location],
    settings: Settings,
    work: WorkOptions,
    world: WorldOptions,
    *,
    masks: Path | None = None,
    fps: float,
    create: bool = False,
    max_size: int | None = None,
) -> None:
    """Add images to a map, attach their poses, and print what was done."""
    check_rate(fps)
    sources = world.read()
    map_ = open_map(folder, create=create, max_size=max_size, settings=settings)
    images = _with_frames(images, folder, settings, fps)
    workers = work.begin("map")
    with shown_progress("images") as show:
        added = map_.add(
            images, jobs=workers.jobs, scheduler=workers.scheduler, progress=show, masks=masks
        )
    for name, reason in added.failed:
        _say(f"left out: {name}: {reason}")
    counts = f"{added.added} added, {added.replaced} replaced, {added.unchanged} unchanged"
    _say(f"{counts}, {len(added.failed)} left out")
    took = added.metrics
    if took.done:
        _say(
            f"{took.wall_seconds:.1f} s, {took.cpu_seconds:.1f} CPU s, {took.workers} "
            f"worker{'s' * (took.workers != 1)}, {took.retried} retried"
        )
    logs.event("images added", map=str(map_.folder), **took.to_dict())
    for source in sources:
        _say(f"{map_.attach(source, images)} images have a pose")


def _with_frames(
    images: Sequence[Location], folder: Location, settings: Settings, fps: float
) -> list[Location]:
    """Return the images with the frames of each video in its place, which are written to files.

    Raises:
        SettingsError: there is a video, and the map is in object storage.
    """
    from nearfar.maps.frames import VideoFrames

    found: list[Location] = []
    for each in images:
        if not (isinstance(each, Path) and is_video_name(each) and not each.is_dir()):
            found.append(each)
            continue
        if not isinstance(folder, Path):
            raise SettingsError(f"the frames of {each} need a map on a disk: give --out a folder")
        frames = folder.parent / f"{folder.name}-frames" / each.stem
        found += VideoFrames(each, frames, fps, settings.max_pixels).files()
    return found


def _complain(reasons: Iterable[str]) -> None:
    sys.stderr.write("".join(f"nearfar: {each}\n" for each in reasons))


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
