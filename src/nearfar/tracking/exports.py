"""A journey in the files of other tools."""

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from nearfar.errors import ExportError, NearfarError, SettingsError
from nearfar.exports.text import quaternion, write_lines
from nearfar.imaging.georeference import WGS84
from nearfar.maps.map import Map
from nearfar.maps.world.places import DECIMALS, GeoOutline, GeoPlace, QueryPose
from nearfar.runtime import require
from nearfar.storage.locations import as_text, replaced
from nearfar.tracking.picture import path_picture
from nearfar.tracking.state import TrackState

States = Sequence[TrackState]


def export_journey(
    map_: Map | None, states: States, formats: Sequence[str], folder: Path
) -> dict[str, str]:
    """Write a journey in several formats; one that fails does not stop the others.

    Args:
        map_: the map; None where it is not at hand, which leaves out pictures.
        states: of the frames, in order.
        formats: names of `FORMATS`.
        folder: folder to write into, which must exist.

    Returns:
        Why a format was not written, by its name.

    Raises:
        SettingsError: there is no such format.
    """
    check_formats(formats)
    failed = {}
    for name in formats:
        file_name, write = FORMATS[name]
        try:
            write(map_, states, folder / file_name)
        except NearfarError as error:
            failed[name] = str(error)
        except OSError as error:
            failed[name] = f"{error.filename or file_name}: {error.strerror or error}"
    return failed


def check_formats(formats: Sequence[str]) -> None:
    """Raise a SettingsError where there is no format of a name."""
    for name in formats:
        if name not in FORMATS:
            raise SettingsError(
                f"unknown format {name!r} of a journey; there are {', '.join(FORMATS)}"
            )


def _posed(states: States) -> list[tuple[TrackState, QueryPose]]:
    """Return the states with a pose that has a position."""
    found = [
        (each, each.world)
        for each in states
        if isinstance(each.world, QueryPose) and each.world.translation is not None
    ]
    if not found:
        raise ExportError(
            "no frame has a pose: the map needs poses (nearfar map build --poses) and the frames "
            "a camera (--intrinsics)"
        )
    return found


def _on_earth(states: States) -> list[tuple[TrackState, GeoPlace, GeoOutline]]:
    """Return the states with a place in longitude and latitude."""
    found = [
        (each, each.world, each.world.longitude_latitude)
        for each in states
        if isinstance(each.world, GeoPlace) and each.world.longitude_latitude is not None
    ]
    if not found:
        raise ExportError("no frame has a place on the Earth: the map is not georeferenced")
    return found


def _write_tum(_: Map | None, states: States, path: Path) -> None:
    """Time, centre of the camera, and quaternion x, y, z, w of the rotation to the world."""
    rows = [
        np.concatenate([[state.time], np.asarray(pose.translation), quaternion(pose.rotation)])
        for state, pose in _posed(states)
    ]
    write_lines(path, rows)


def _write_kitti(_: Map | None, states: States, path: Path) -> None:
    """Write the 12 numbers of world_from_camera for each frame with a pose."""
    rows = [
        np.column_stack([pose.rotation, np.asarray(pose.translation)]).ravel()
        for _, pose in _posed(states)
    ]
    write_lines(path, rows)


def _write_gpx(__: Map | None, states: States, path: Path) -> None:
    """Write a track of the frames' centres on the ground; predicted places are marked."""
    root = ET.Element(
        "gpx", version="1.1", creator="nearfar", xmlns="http://www.topografix.com/GPX/1/1"
    )
    segment = ET.SubElement(ET.SubElement(root, "trk"), "trkseg")
    for state, _, place in _on_earth(states):
        longitude, latitude = (f"{value:.{DECIMALS}f}" for value in place.centre)
        point = ET.SubElement(segment, "trkpt", lat=latitude, lon=longitude)
        ET.SubElement(point, "name").text = as_text(state.name or str(state.index))
        ET.SubElement(point, "desc").text = f"{state.time:.3f} s, {state.status}"
    with replaced(path) as out:
        ET.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)


def _write_geojson(_: Map | None, states: States, path: Path) -> None:
    """Write the track as a line, and each frame as a point with its attributes."""
    placed = _on_earth(states)
    line = [place.centre.round(DECIMALS).tolist() for *_, place in placed]
    features = [
        _feature("Point", at, _attributes(state, world))
        for (state, world, _), at in zip(placed, line, strict=True)
    ]
    if len(line) > 1:
        features.insert(0, _feature("LineString", line, {"frames": len(line)}))
    content = {"type": "FeatureCollection", "features": features}
    with replaced(path) as out:
        out.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _attributes(state: TrackState, place: GeoPlace) -> dict[str, Any]:
    return {
        "index": state.index,
        "time": state.time,
        "name": as_text(state.name or ""),
        "status": state.status,
        "confidence": state.confidence,
        "heading": place.heading,
        "resolution": place.resolution,
        "height": state.height,
        "error": place.error,
    }


def _write_geopackage(_: Map | None, states: States, path: Path) -> None:
    """Write the layers `frames`, of points, and `track`, a line, in longitude and latitude."""
    require("geo", "rasterio", "pyogrio", "shapely")
    import shapely
    from pyogrio.raw import write

    placed = _on_earth(states)
    rows = [_attributes(state, world) for state, world, _ in placed]
    columns = {name: _column([row[name] for row in rows]) for name in rows[0]}
    points = [shapely.Point(place.centre) for *_, place in placed]
    layers: list[tuple[str, list[Any], dict[str, np.ndarray[Any, Any]], str]] = [
        ("frames", points, columns, "Point")
    ]
    if len(points) > 1:
        line = shapely.LineString([place.centre for *_, place in placed])
        layers.append(("track", [line], {"frames": np.array([len(points)])}, "LineString"))
    with TemporaryDirectory(dir=path.parent, prefix=".export-") as folder:
        made = Path(folder) / "track.gpkg"  # GDAL warns about names that do not end in .gpkg.
        for number, (layer, shapes, values, kind) in enumerate(layers):
            write(
                str(made),
                shapely.to_wkb(np.array(shapes, object)),
                list(values.values()),
                list(values),
                layer=layer,
                driver="GPKG",
                geometry_type=kind,
                crs=WGS84,
                append=number > 0,
            )
        made.replace(path)


def _column(values: list[Any]) -> np.ndarray[Any, Any]:
    if any(isinstance(each, str) for each in values):
        return np.array(values, object)
    return np.array([np.nan if each is None else each for each in values], np.float64)


COVARIANCE = [(row, column) for row in range(4) for column in range(row, 4)]
"""Cells of the covariance in a table: the upper triangle, row by row."""
POSE_COVARIANCE = [(row, column) for row in range(3) for column in range(row, 3)]


def _write_csv(_: Map | None, states: States, path: Path) -> None:
    """Write a row for each frame, with the covariance of its place."""
    numbers = ["x", "y", "log_scale", "rotation"]
    header = [
        *("index", "time", "name", "status", "image", "confidence", "expected_error", "inliers"),
        *numbers,
        *(f"cov_{numbers[row]}_{numbers[column]}" for row, column in COVARIANCE),
        *("longitude", "latitude", "heading", "height"),
        *("pose_x", "pose_y", "pose_z", "pose_qx", "pose_qy", "pose_qz", "pose_qw"),
        *(f"cov_pose_{'xyz'[row]}_{'xyz'[column]}" for row, column in POSE_COVARIANCE),
    ]
    with replaced(path) as out, out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for state in states:
            writer.writerow(["" if cell is None else cell for cell in _cells(state)])


def _cells(state: TrackState) -> Iterator[Any]:
    yield from (state.index, state.time, as_text(state.name or ""), state.status)
    yield from (as_text(state.image or ""), state.confidence, state.expected_error, state.inliers)
    yield from _numbers(state.place, 4)
    known = state.covariance
    yield from (None if known is None else float(known[cell]) for cell in COVARIANCE)
    world = state.world
    on_earth = world.longitude_latitude if isinstance(world, GeoPlace) else None
    yield from _numbers(None if on_earth is None else on_earth.centre, 2)
    yield world.heading if isinstance(world, GeoPlace) else None
    yield state.height
    posed = isinstance(world, QueryPose) and world.translation is not None
    yield from _numbers(world.translation if isinstance(world, QueryPose) else None, 3)
    rotation = quaternion(world.rotation) if posed and isinstance(world, QueryPose) else None
    yield from _numbers(rotation, 4)
    spread = state.pose_covariance
    yield from (None if spread is None else float(spread[cell]) for cell in POSE_COVARIANCE)


def _numbers(values: np.ndarray[Any, Any] | None, count: int) -> list[float | None]:
    return [None] * count if values is None else [float(each) for each in values]


def _write_picture(map_: Map | None, states: States, path: Path) -> None:
    """Draw the path on a map image, or as seen from above."""
    if map_ is None:
        raise ExportError("a picture of the path needs the map")
    path_picture(map_, states, path)


FORMATS: dict[str, tuple[str, Callable[[Map | None, States, Path], None]]] = {
    "csv": ("track.csv", _write_csv),
    "geojson": ("track.geojson", _write_geojson),
    "geopackage": ("track.gpkg", _write_geopackage),
    "gpx": ("track.gpx", _write_gpx),
    "kitti": ("track-kitti.txt", _write_kitti),
    "png": ("track.png", _write_picture),
    "tum": ("track-tum.txt", _write_tum),
}
"""Formats of a journey: the name of the file, and what writes it."""
