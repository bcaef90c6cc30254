"""`nearfar map`."""

import itertools
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from nearfar.cli.options import Flag, WeightOptions, with_weights
from nearfar.cli.status import BAD_INPUT, FAILED
from nearfar.cli.world_options import NO_WORLD, WorldOptions
from nearfar.errors import ImageError
from nearfar.intrinsics import read_camera
from nearfar.maps import DEFAULTS, open_map
from nearfar.maps.answers import MapLocalization
from nearfar.maps.world.geojson import feature_collection
from nearfar.maps.world.places import GeoPlace, QueryPose

if TYPE_CHECKING:
    from nearfar.cli.world_options import Attach
    from nearfar.maps.build import Added
    from nearfar.maps.map import Map

map_app = App(name="map", help="Keep a map of many images, and locate others in it.")

MapFolder = Annotated[Path, Parameter(name="MAP")]
LONGEST_CRS = 20
"""Characters; the name of a system that has no code is pages of WKT."""
AsJson = Annotated[Flag, Parameter(name="--json")]


@map_app.command(name="build")
def build_command(
    images: list[Path],
    /,
    *,
    out: Path,
    max_size: int | None = None,
    max_pixels: int = DEFAULTS.max_pixels,
    jobs: int = 1,
    weights: WeightOptions = (),
    world: WorldOptions = NO_WORLD,
) -> None:
    """Make a map of IMAGES, or complete one.

    Images that are in the map already and have not changed are left, those that have changed are
    replaced. A build that was stopped goes on where it was.

    Args:
        images: Images, and folders, of which all images are added.
        out: Folder of the map.
        max_size: Reduce images so that neither side exceeds this; by default they are not reduced.
        max_pixels: Skip larger images, which may be decompression bombs.
        jobs: Processes that describe images.
        weights: Model of the descriptor, nearfar=FILE.
    """
    settings = with_weights(DEFAULTS.replace(max_pixels=max_pixels), weights)
    attachments = world.read()
    opened = open_map(out, create=True, max_size=max_size, settings=settings)
    with _progress() as show:
        added = opened.add(images, jobs=jobs, progress=show)
    _tell(added)
    _attach(attachments, opened, images)


@map_app.command(name="add")
def add_command(
    folder: MapFolder,
    images: list[Path],
    /,
    *,
    max_pixels: int = DEFAULTS.max_pixels,
    jobs: int = 1,
    weights: WeightOptions = (),
    world: WorldOptions = NO_WORLD,
) -> None:
    """Add IMAGES to a map that exists.

    Args:
        folder: Folder of the map.
        images: Images, and folders, of which all images are added.
        max_pixels: Skip larger images, which may be decompression bombs.
        jobs: Processes that describe images.
        weights: Model of the descriptor, nearfar=FILE.
    """
    settings = with_weights(DEFAULTS.replace(max_pixels=max_pixels), weights)
    attachments = world.read()
    opened = open_map(folder, settings=settings)
    with _progress() as show:
        added = opened.add(images, jobs=jobs, progress=show)
    _tell(added)
    _attach(attachments, opened, images)


@map_app.command(name="remove")
def remove_command(folder: MapFolder, names: list[str], /) -> None:
    """Remove images from a map; their files are left.

    Args:
        folder: Folder of the map.
        names: Names as `nearfar map info` shows them, or paths.
    """
    _say(f"{open_map(folder).remove(names)} removed")


@map_app.command(name="info")
def info_command(folder: MapFolder, /, *, as_json: AsJson = False) -> None:
    """Say what is in a map.

    Args:
        folder: Folder of the map.
        as_json: Print one JSON object instead of text.
    """
    opened = open_map(folder)
    images, made = opened.images, asdict(opened.manifest)
    if as_json:
        _say(json.dumps({"map": str(folder), **made, "images": [asdict(each) for each in images]}))
        return
    landmarks = sum(image.landmarks for image in images)
    _say(f"{len(images)} images, {landmarks} landmarks")
    _say(", ".join(f"{name.replace('_', ' ')} {value}" for name, value in made.items()))
    for image in images:
        size = f"{image.width}x{image.height}, {image.landmarks} landmarks"
        _say(f"{image.name}: {size if image.usable else image.status}")


@map_app.command(name="verify")
def verify_command(folder: MapFolder, /) -> int:
    """Check a map and the files of its images.

    Exit status: 0 no problem, 3 problems, one a line, 2 bad input or usage.

    Args:
        folder: Folder of the map.
    """
    opened = open_map(folder)
    problems = opened.problems()
    for problem in problems:
        _say(f"{problem.image or folder}: {problem.what}")
    if not problems:
        _say(f"{len(opened.images)} images, no problem")
    return FAILED if problems else 0


@map_app.command(name="compact")
def compact_command(folder: MapFolder, /) -> None:
    """Merge the files of a map, remove what it no longer needs, and index many landmarks.

    Args:
        folder: Folder of the map.
    """
    indexed = open_map(folder).compact()
    _say("compacted; landmarks are indexed" if indexed else "compacted")


@map_app.command(name="locate")
def locate_command(
    folder: MapFolder,
    queries: list[Path],
    /,
    *,
    as_json: AsJson = False,
    save: Path | None = None,
    geojson: Path | None = None,
    intrinsics: Path | None = None,
    top: int = 1,
    verify: int = 5,
    max_effort: Literal["points", "landmarks", "zoom", "views"] = DEFAULTS.max_effort,
    min_confidence: float = DEFAULTS.min_confidence,
    max_pixels: int = DEFAULTS.max_pixels,
    weights: WeightOptions = (),
) -> int:
    """Find where QUERIES lie in a map.

    Exit status: 0 all located, 3 some not found, 2 bad input or usage.

    Args:
        folder: Folder of the map.
        queries: Images to locate.
        as_json: Print one JSON object a query, each on a line of its own, instead of text.
        save: Folder for a JSON file and a picture of each query.
        geojson: File for the footprints of all queries that lie in GeoTIFFs, in longitude and
            latitude.
        intrinsics: Camera that took the queries, to find their poses where those of map images are
            known: JSON file {"query": [fx, fy, cx, cy]} in pixels, or KITTI's calib.txt.
        top: How many answers to seek.
        verify: How many places to look at, those with most votes of landmarks.
        max_effort: The last step of the method adaptive to try at each place.
        min_confidence: A place of less calibrated confidence is no answer.
        max_pixels: Refuse larger images, which may be decompression bombs.
        weights: Model of the descriptor, nearfar=FILE.
    """
    settings = DEFAULTS.replace(
        max_effort=max_effort, min_confidence=min_confidence, max_pixels=max_pixels
    )
    opened = open_map(folder, settings=with_weights(settings, weights))
    camera = None if intrinsics is None else read_camera(intrinsics, "query")
    located, statuses = [], {0}
    with _progress() as show:
        for done, (query, name) in enumerate(zip(queries, _names(queries), strict=True)):
            show(done, len(queries))
            try:
                found = opened.locate(query, top=top, verify=verify, intrinsics=camera)
            except ImageError as error:
                print(f"nearfar: {error}", file=sys.stderr)  # noqa: T201
                statuses.add(BAD_INPUT)
                continue
            _say(found.to_json() if as_json else _text(found, posing=camera is not None))
            if save is not None:
                found.save(save, name)
            located.append(found)
            statuses.add(0 if found.located else FAILED)
    if geojson is not None:
        geojson.write_text(feature_collection(located) + "\n", encoding="utf-8")
    return BAD_INPUT if BAD_INPUT in statuses else max(statuses)


def _names(queries: list[Path]) -> list[str]:
    """A name for the files of each query; further queries of the same name are numbered."""
    names: dict[str, None] = {}
    for query in queries:
        numbered = (f"{query.stem}-{number}" for number in itertools.count(2))
        names[
            next(name for name in itertools.chain([query.stem], numbered) if name not in names)
        ] = None
    return list(names)


def _text(found: MapLocalization, *, posing: bool) -> str:
    if not found.located:
        return f"{found.query}: not found; {found.reason}"
    lines = [f"{found.query}: located"]
    for answer in found.answers:
        lines.append(
            f"  {answer.image}: confidence {answer.confidence:.2f}, scale change "
            f"{answer.scale_change:.2f}x, {answer.votes:.1f} votes"
        )
        if answer.footprint is not None:
            corners = "  ".join(f"({x:.1f}, {y:.1f})" for x, y in answer.footprint)
            lines.append(f"  outline in it: {corners}")
        if answer.world is not None:
            lines.append(f"  centre: {_geo_text(answer.world)}")
    if found.pose is not None:
        lines.append(f"  {_pose_text(found.pose)}")
    elif posing:
        lines.append("  no pose: none of these map images has one (nearfar map add --help)")
    stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in found.seconds.items())
    return "\n".join([*lines, f"  {sum(found.seconds.values()):.2f} s ({stages})"])


def _geo_text(place: GeoPlace) -> str:
    x, y = place.outline.centre
    crs = place.crs if len(place.crs) <= LONGEST_CRS else "the raster's system"
    projected = f"({x:.2f}, {y:.2f}) in {crs}"
    if place.longitude_latitude is None:
        return projected
    longitude, latitude = place.longitude_latitude.centre
    return f"longitude {longitude:.7f}, latitude {latitude:.7f}; {projected}"


def _pose_text(pose: QueryPose) -> str:
    basis = f"{pose.inliers} matches with {', '.join(pose.images)}"
    if pose.translation is None:
        x, y, z = pose.to_dict()["direction"]
        away = f"direction ({x:.3f}, {y:.3f}, {z:.3f}) from {pose.images[0]}"
        return f"{away}, distance unknown; {basis}"
    x, y, z = pose.translation
    return f"camera at ({x:.3f}, {y:.3f}, {z:.3f}) in {pose.world}, by {pose.source}; {basis}"


def _attach(attachments: "list[Attach]", opened: "Map", images: list[Path]) -> None:
    for attach in attachments:
        _say(f"{attach(opened, images)} images have a pose")


def _tell(added: "Added") -> None:
    for name, reason in added.failed:
        _say(f"left out: {name}: {reason}")
    counts = f"{added.added} added, {added.replaced} replaced, {added.unchanged} unchanged"
    _say(f"{counts}, {len(added.failed)} left out")


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """A bar on the terminal, if there is one, and what moves it: done, of how many."""
    terminal = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=terminal, transient=True, disable=not terminal.is_terminal
    ) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)
