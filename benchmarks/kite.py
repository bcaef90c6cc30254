"""Follow the kite photographs in order of capture over their orthophoto.

    python benchmarks/kite.py PAIRS/copr --out kite

The folder has `map.png`, and for each photograph a folder with `pair.json`, see `nearfar bench
pairs`. Photographs are taken in the order of their names. The error is the mean distance of the
points of `pair.json` from their true places, in map pixels. Each photograph is also located alone.
"""

import argparse
import json
import math
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np

import nearfar
from nearfar.geometry.homography import transform
from nearfar.tracking import Tracker


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    shutil.rmtree(asked.out, ignore_errors=True)
    asked.out.mkdir(parents=True)
    map_ = nearfar.open_map(asked.out / "map", create=True)
    map_.add([asked.folder / "map.png"])
    rows: list[dict[str, Any]] = []
    with Tracker(map_, budget=math.inf) as tracker:
        for file in sorted(asked.folder.glob("*/pair.json")):
            pair = json.loads(file.read_text())
            near, far = (np.array(pair[f"{side}_points"], np.float64) for side in ("near", "far"))
            photograph, number = file.parent / pair["near"], float(file.parent.name[-4:])
            row: dict[str, Any] = {"name": file.parent.name}
            began = time.process_time()
            state = tracker.update(photograph, number)
            row |= {"cpu_seconds": time.process_time() - began, "status": state.status}
            row |= {"step": state.step, "confidence": state.confidence}
            row["error"] = _error(state.far_from_near if state.known else None, near, far)
            began = time.process_time()
            found = map_.locate(photograph).answers
            row["alone_cpu_seconds"] = time.process_time() - began
            row["alone_error"] = _error(found[0].far_from_near if found else None, near, far)
            rows.append(row)
            print(json.dumps(row), flush=True)
    correct = [row for row in rows if row["error"] is not None and row["error"] <= 3]
    alone = [row for row in rows if row["alone_error"] is not None and row["alone_error"] <= 3]
    wrong = [row for row in rows if row["error"] is not None and row["error"] > 3]
    summary = {
        "photographs": len(rows),
        "within_3": len(correct),
        "tracked": sum(row["status"] == "tracked" for row in rows),
        "confident_and_wrong": sum(row["confidence"] >= 0.5 for row in wrong),
        "alone_within_3": len(alone),
        "cpu_seconds": float(np.mean([row["cpu_seconds"] for row in rows])),
        "alone_cpu_seconds": float(np.mean([row["alone_cpu_seconds"] for row in rows])),
    }
    print(json.dumps(summary))


def _error(found: Any, near: np.ndarray, far: np.ndarray) -> float | None:
    if found is None:
        return None
    return float(np.linalg.norm(transform(np.asarray(found), near) - far, axis=1).mean())


if __name__ == "__main__":
    main()
