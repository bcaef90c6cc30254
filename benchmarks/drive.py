"""Follow a drive of KITTI through a map of every third frame, and compare with locating alone.

    python benchmarks/drive.py KITTI/sequences/03 KITTI/poses/03.txt --out drive [--frames 60]

The map has every third of the given frames with their poses. All others are followed in order. A
gap leaves out 10 frames in a row. The table has the share with a pose, the position error of those
in metres, median and 95 %, frames until the first pose after the gap, and CPU seconds a frame, also
of every fourth frame located alone. Then the path is smoothed, and its errors are printed beside
those before, also of the frames that are hidden from the smoothing: every third one.
"""

import argparse
import json
import math
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import nearfar
from nearfar.maps.sources import read_source
from nearfar.maps.world.places import QueryPose
from nearfar.tracking import PoseTracker, TrackState
from nearfar.tracking.smoothing import smoothed

RATE = 10.0
"""Frames a second of KITTI."""
GAP = 10
"""Frames that are left out half way."""
ALONE_EACH = 4
"""Of so many frames one is also located alone."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("poses", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=1000)
    asked = parser.parse_args()
    files = sorted((asked.sequence / "image_0").glob("*.png"))[: asked.frames]
    truth = np.loadtxt(asked.poses).reshape(-1, 3, 4)
    shutil.rmtree(asked.out, ignore_errors=True)
    asked.out.mkdir(parents=True)
    mapped = files[::3]
    lines = [truth[int(each.stem)].ravel() for each in mapped]
    np.savetxt(asked.out / "poses.txt", lines)
    intrinsics = str(asked.sequence / "calib.txt")
    map_ = nearfar.open_map(asked.out / "map", create=True)
    map_.add(mapped)
    map_.attach(read_source("kitti", asked.out / "poses.txt", intrinsics), mapped)
    others = [each for each in files if each not in set(mapped)]
    middle = len(others) // 2
    others = others[:middle] + others[middle + GAP :]
    rows: list[dict[str, Any]] = []
    states: list[TrackState] = []
    tracker = PoseTracker(map_, intrinsics=intrinsics, budget=math.inf)
    with (asked.out / "frames.jsonl").open("w") as out:
        for number, file in enumerate(others):
            at = int(file.stem)
            began = time.process_time()
            state = tracker.update(file, at / RATE)
            states.append(state)
            row: dict[str, Any] = {"frame": at, "status": state.status, "gap": number >= middle}
            row["cpu_seconds"] = time.process_time() - began
            row["error"] = _error(state.world, truth[at]) if state.known else None
            row |= {"step": state.step, "inliers": state.inliers, "confidence": state.confidence}
            row["deviations"] = _deviations(state.world, truth[at]) if state.known else None
            row["seconds"] = state.seconds
            if number % ALONE_EACH == 0:
                began = time.process_time()
                found = map_.locate(file, intrinsics=intrinsics).pose
                row["alone_cpu_seconds"] = time.process_time() - began
                row["alone_error"] = _error(found, truth[at])
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
    shown = [truth[row["frame"]] for row in rows]
    print(json.dumps(_summary(rows) | _smoothed(states, shown), indent=1))


def _smoothed(states: list[TrackState], truth: list[np.ndarray[Any, Any]]) -> dict[str, Any]:
    """Return errors of the smooth path, and of one from which every third frame was hidden."""
    found: dict[str, Any] = {}
    hidden = [
        replace(each, status="lost", world=None) if k % 3 == 1 else each
        for k, each in enumerate(states)
    ]
    for name, given, first, step in (("smooth", states, 0, 1), ("hidden", hidden, 1, 3)):
        errors = [
            _error(state.world, pose)
            for state, pose in list(zip(smoothed(given), truth, strict=True))[first::step]
        ]
        known = [each for each in errors if each is not None]
        found |= {f"{name}_frames": len(known), f"{name}_median": float(np.median(known))}
        found[f"{name}_95%"] = float(np.percentile(known, 95))
    return found


def _error(found: object, truth: np.ndarray[Any, Any]) -> float | None:
    if not isinstance(found, QueryPose) or found.translation is None:
        return None
    return float(np.linalg.norm(found.translation - truth[:, 3]))


def _deviations(found: object, truth: np.ndarray[Any, Any]) -> float | None:
    """Return the root of the mean squared error of the centre in its standard deviations."""
    if not isinstance(found, QueryPose) or found.translation is None or found.covariance is None:
        return None
    off = truth[:, 3] - found.translation
    return float(np.sqrt(off @ np.linalg.solve(found.covariance[3:, 3:], off) / 3))


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    errors = [row["error"] for row in rows if row["error"] is not None]
    alone = [row for row in rows if "alone_cpu_seconds" in row]
    alone_errors = [row["alone_error"] for row in alone if row["alone_error"] is not None]
    same = [row["error"] for row in alone if row["error"] is not None]
    tracked = [row for row in rows if row["status"] == "tracked"]
    deviations = [row["deviations"] for row in tracked if row["deviations"] is not None]
    after = [row["error"] is not None for row in rows if row["gap"]]
    return {
        "frames": len(rows),
        "with_pose": len(errors),
        "tracked": len(tracked),
        "median": float(np.median(errors)),
        "95%": float(np.percentile(errors, 95)),
        "frames_until_pose_after_gap": after.index(True) + 1 if any(after) else None,
        "cpu_seconds": float(np.mean([row["cpu_seconds"] for row in rows])),
        "tracked_cpu_seconds": float(np.median([row["cpu_seconds"] for row in tracked])),
        "tracked_seconds": float(np.mean([row["seconds"] for row in tracked])),
        "deviations_median": float(np.median(deviations)),
        "deviations_95%": float(np.percentile(deviations, 95)),
        "alone": len(alone),
        "median_of_the_same": float(np.median(same)),
        "alone_with_pose": len(alone_errors),
        "alone_median": float(np.median(alone_errors)) if alone_errors else None,
        "alone_cpu_seconds": float(np.mean([row["alone_cpu_seconds"] for row in alone])),
    }


if __name__ == "__main__":
    main()
