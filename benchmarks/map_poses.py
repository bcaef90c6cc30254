"""Poses of KITTI frames in a map of other frames with known poses.

    python benchmarks/map_poses.py KITTI MAP [--every 3] [--queries 40]

Of the frames that are there, one in so many is in MAP, which is made where it is missing; of the
others so many, evenly spread, are queries. One JSON object a query, then a summary.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearfar import open_map
from nearfar.geometry.camera_files import read_camera
from nearfar.geometry.errors import rotation_angle
from nearfar.maps.answers import MapLocalization
from nearfar.maps.map import Map
from nearfar.maps.sources.poses import Kitti, PoseList
from nearfar.settings import Settings

NEAR = 10.0
"""Metres within which the first frame is to be."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A sequence: its frames that are there, and all poses."""

    frames: list[Path]
    poses: PoseList


def drives(folder: Path) -> Iterator[Drive]:
    """The sequences of a folder of the official layout of which there are left grey frames."""
    for sequence in sorted((folder / "sequences").iterdir()):
        frames = sorted((sequence / "image_0").glob("*.png"))
        if frames:
            camera = read_camera(sequence / "calib.txt", "map")
            poses = folder / "poses" / f"{sequence.name}.txt"
            yield Drive(frames, Kitti("kitti", Settings()).read(poses, camera))


def made(folder: Path, known: list[Drive], every: int) -> Map:
    """The map."""
    if Map.exists(folder):
        return open_map(folder)
    map_ = open_map(folder, create=True)
    for drive in known:
        map_.add(drive.frames[::every])
        map_.attach(drive.poses, drive.frames[::every])
    return map_


def result(query: Path, drive: Drive, found: MapLocalization) -> dict[str, Any]:
    """What was found of a query, in metres, degrees and seconds."""
    row: dict[str, Any] = {"query": query.as_posix(), "seconds": sum(found.seconds.values())}
    frame = int(query.stem)
    truth = drive.poses.centres[frame]
    if found.answers:
        best = Path(found.answers[0].image)
        row["first"] = best.as_posix()
        if best.parts[-3:-1] == query.parts[-3:-1]:
            row["apart"] = float(np.linalg.norm(drive.poses.centres[int(best.stem)] - truth))
    if found.pose is not None:
        row |= {"source": found.pose.source, "inliers": found.pose.inliers}
        row["turned"] = rotation_angle(found.pose.rotation, drive.poses.rotations[frame])
        if found.pose.translation is not None:
            row["error"] = float(np.linalg.norm(found.pose.translation - truth))
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kitti", type=Path)
    parser.add_argument("map", type=Path)
    parser.add_argument("--every", type=int, default=3)
    parser.add_argument("--queries", type=int, default=40)
    asked = parser.parse_args()
    known = list(drives(asked.kitti))
    map_ = made(asked.map, known, asked.every)
    others = [
        (frame, drive)
        for drive in known
        for index, frame in enumerate(drive.frames)
        if index % asked.every
    ]
    chosen = np.linspace(0, len(others) - 1, asked.queries).astype(int)
    rows = []
    for query, drive in (others[index] for index in chosen):
        rows.append(result(query, drive, map_.locate(query, intrinsics=drive.poses.camera)))
        print(json.dumps(rows[-1]), flush=True)
    near = sum(row.get("apart", np.inf) <= NEAR for row in rows)
    errors = [row["error"] for row in rows if "error" in row]
    print(f"{near} of {len(rows)} with a frame within {NEAR:.0f} m first")
    print(f"{len(errors)} with a position")
    if errors:
        print("error in metres: median {:.3f}, 90 % {:.3f}, largest {:.3f}".format(*at(errors)))
        turned = at([row["turned"] for row in rows if "error" in row])
        print("in degrees: median {:.3f}, 90 % {:.3f}, largest {:.3f}".format(*turned))
    seconds = at([row["seconds"] for row in rows])
    print("seconds: median {:.1f}, 90 % {:.1f}, largest {:.1f}".format(*seconds))


def at(values: list[float]) -> list[float]:
    """Median, 90 % and largest."""
    return [float(value) for value in np.percentile(values, [50, 90, 100])]


if __name__ == "__main__":
    main()
