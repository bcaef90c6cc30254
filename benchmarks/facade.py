"""Follow a camera along a made facade of equal windows, from one unique start to the end.

    python benchmarks/facade.py START WINDOW --out facade

The facade begins with the photograph START. A row of equal windows, each the photograph WINDOW,
follows it. Frames of 640x480 pixels show it at twice its resolution, about one and a half windows
each, with blur, another exposure and noise. The camera flies from the start to the last window.
The output has the frames whose centre is within 3 map pixels of its true place, the first frame
that is a window off, and the same of every tenth frame located alone. The path is drawn in the
folder, as `path.png`.
"""

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

import nearfar
from flight import SIZE, disturbed, homography
from nearfar.arrays import RGBPixels
from nearfar.imaging.image import read_image
from nearfar.tracking import Tracker, TrackState
from nearfar.tracking.picture import path_picture

HEIGHT, PERIOD, WINDOWS, START = 320, 220, 16, 420
STEP = 36.0
"""Map pixels from frame to frame."""
ALONE_EACH = 10


def made_facade(start: RGBPixels, window: RGBPixels) -> RGBPixels:
    """Return the facade: a unique start and equal windows, with noise of a camera."""
    wall = np.full((HEIGHT, START + WINDOWS * PERIOD, 3), 150, np.uint8)
    wall[:, :START] = cv2.resize(start, (START, HEIGHT), interpolation=cv2.INTER_AREA)
    pane = cv2.resize(window, (PERIOD - 30, HEIGHT - 40), interpolation=cv2.INTER_AREA)
    for index in range(WINDOWS):
        wall[20 : HEIGHT - 20, START + index * PERIOD + 15 :][:, : PERIOD - 30] = pane
    noise = np.random.default_rng(1).normal(0, 2, wall.shape)
    return np.asarray(np.clip(wall + noise, 0, 255), np.uint8)


def off(found: np.ndarray, x: float, y: float) -> float:
    """Return how far the centre of a frame is from its true place, in map pixels."""
    seen = found @ [(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, 1]
    return float(np.hypot(seen[0] / seen[2] - x, seen[1] / seen[2] - y))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("start", type=Path)
    parser.add_argument("window", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--alone", type=int, default=10, help="most frames to locate alone")
    asked = parser.parse_args()
    shutil.rmtree(asked.out, ignore_errors=True)
    asked.out.mkdir(parents=True)
    facade = made_facade(read_image(asked.start).pixels, read_image(asked.window).pixels)
    Image.fromarray(facade).save(asked.out / "facade.png")
    map_ = nearfar.open_map(asked.out / "map", create=True)
    map_.add([asked.out / "facade.png"])
    rng = np.random.default_rng(0)
    rows: list[dict[str, Any]] = []
    alone: list[float | None] = []
    states: list[TrackState] = []
    with Tracker(map_, budget=float("inf")) as tracker:
        for index, x in enumerate(np.arange(180.0, facade.shape[1] - 170, STEP)):
            y = HEIGHT / 2 + 20 * np.sin(index / 9)
            model = homography(float(x), y, 2.0, 0.03 * np.sin(index / 7), np.zeros(2))
            flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
            seen = cv2.warpPerspective(
                facade, model, SIZE, flags=flags, borderMode=cv2.BORDER_REFLECT
            )
            frame = disturbed(np.asarray(seen), rng)
            state = tracker.update(frame, index / 10)
            states.append(state)
            apart = None if state.far_from_near is None else off(state.far_from_near, float(x), y)
            rows.append({"x": float(x), "status": state.status, "off": apart})
            if index % ALONE_EACH == 0 and len(alone) < asked.alone:
                found = map_.locate(frame)
                best = found.answers[0].far_from_near if found.answers else None
                alone.append(None if best is None else off(np.asarray(best), float(x), y))
    path_picture(map_, states, asked.out / "path.png")
    (asked.out / "frames.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    astray = [k for k, row in enumerate(rows) if row["off"] is None or row["off"] > PERIOD / 2]
    summary = {
        "frames": len(rows),
        "within_3": sum(row["off"] is not None and row["off"] <= 3 for row in rows),
        "matched": sum(row["status"] in ("tracked", "relocalized") for row in rows),
        "first_astray": astray[0] if astray else None,
        "last_off": rows[-1]["off"],
        "alone": len(alone),
        "alone_within_3": sum(each is not None and each <= 3 for each in alone),
    }
    print(json.dumps(summary, indent=1))


if __name__ == "__main__":
    main()
