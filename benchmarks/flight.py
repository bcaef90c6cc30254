"""Follow made flights over an orthophoto, and compare with locating each frame alone.

    python benchmarks/flight.py ORTHOPHOTO --centres 180 390 1640 600 --other OTHER --out flight

Each flight shows ORTHOPHOTO at 3 to 10 times its resolution in frames of 640x480 pixels. The camera
flies curves, climbs and sinks, and turns. Frames are blurred, noisy and exposed differently, and a
tenth of them is hidden: half are grey and half show OTHER, an unrelated photograph. The truth is
exact. Every tenth frame is
also located alone in the map, as `nearfar map locate` does.

The table has, of the frames that show the map: the share with a place, the root mean square error
of tracked frames in map pixels (mean over a grid of the frame), the share within 3 map pixels,
frames of any kind that are more than 3 pixels off with a confidence of 0.5 or more, and CPU seconds
a frame. Rows are written to `frames.jsonl` in the folder.
"""

import argparse
import json
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import nearfar
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.geometry.homography import transform
from nearfar.imaging.image import read_image
from nearfar.tracking import Tracker

SIZE = (640, 480)
"""Width and height of the frames, in pixels."""
RATE = 10.0
"""Frames a second."""
HIDDEN = 0.1
"""Share of the frames that do not show the map, in runs of 1 to 6."""
CORRECT = 3.0
"""Largest mean error of a correct frame, in map pixels."""
ALONE_EACH = 10
"""Of so many frames one is located alone."""


@dataclass(frozen=True, eq=False)
class MadeFrame:
    """A frame and where it lies.

    Attributes:
        pixels: the frame.
        map_from_frame: the truth.
        hidden: whether it does not show the map.
    """

    pixels: RGBPixels
    map_from_frame: Matrix3
    hidden: bool


def path_of(
    count: int, box: tuple[float, float, float, float], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return (count, 4): x, y, enlargement and rotation of each frame; smooth curves.

    Args:
        count: number of frames.
        box: left, top, right and bottom of the centres of the frames, in map pixels.
        rng: of the random curves.
    """
    steps = np.arange(count)
    waves = [
        sum(
            rng.uniform(0.3, 1) * np.sin(2 * np.pi * steps / rng.uniform(*period) + phase)
            for phase in rng.uniform(0, 2 * np.pi, 3)
        )
        for period in ((80, 300), (80, 300), (60, 200))
    ]
    x, y, height = (each / np.abs(each).max() for each in waves)
    enlarged = np.exp(np.log(30) / 2 + height * np.log(10 / 3) / 2)
    left, top, right, bottom = box
    across, down = (right - left) / 2, (bottom - top) / 2
    turn = np.cumsum(rng.normal(0, 0.5, count))
    turn = np.radians(cv2.GaussianBlur(turn[np.newaxis], (0, 0), 5)[0] * 8)
    return np.column_stack([left + across * (1 + x), top + down * (1 + y), enlarged, turn])


def hidden_frames(count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return (count,) which frames are hidden: runs of 1 to 6, none of the first 5."""
    hidden = np.zeros(count, np.bool_)
    while hidden.sum() < HIDDEN * count:
        start = rng.integers(5, count)
        hidden[start : start + rng.integers(1, 7)] = True
    return hidden


def made_frames(
    orthophoto: RGBPixels,
    other: RGBPixels,
    box: tuple[float, float, float, float],
    count: int,
    rng: np.random.Generator,
) -> Iterator[MadeFrame]:
    """Yield the frames of a flight."""
    hidden = hidden_frames(count, rng)
    tilt = rng.uniform(-1e-4, 1e-4, (count, 2))
    tilt = np.cumsum(tilt, axis=0) / np.sqrt(np.arange(1, count + 1))[:, np.newaxis]
    for index, (x, y, enlarged, turn) in enumerate(path_of(count, box, rng)):
        model = homography(x, y, enlarged, turn, tilt[index])
        if hidden[index]:
            grey = np.full((SIZE[1], SIZE[0], 3), rng.integers(20, 230), np.uint8)
            shown = cv2.resize(other, SIZE, interpolation=cv2.INTER_AREA)
            pixels = grey if rng.random() < 0.5 else np.asarray(shown)
        else:
            flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
            pixels = np.asarray(
                cv2.warpPerspective(
                    orthophoto, model, SIZE, flags=flags, borderMode=cv2.BORDER_REFLECT
                )
            )
        yield MadeFrame(disturbed(pixels, rng), model, bool(hidden[index]))


def homography(
    x: float, y: float, enlarged: float, turn: float, tilt: NDArray[np.float64]
) -> Matrix3:
    """Return the homography from a frame with its centre at a point of the map."""
    cos, sin = np.cos(turn) / enlarged, np.sin(turn) / enlarged
    centre = (np.array(SIZE) - 1) / 2
    linear = np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])
    tilted = np.array([[1, 0, 0], [0, 1, 0], [*tilt, 1.0]])
    moved = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1.0]])
    return np.asarray(linear @ tilted @ moved)


def disturbed(pixels: RGBPixels, rng: np.random.Generator) -> RGBPixels:
    """Return a frame with blur, another exposure and noise."""
    blurred = cv2.GaussianBlur(pixels, (0, 0), rng.uniform(0.5, 3.0)).astype(np.float32)
    exposed = 255 * (blurred / 255) ** rng.uniform(0.7, 1.4) * rng.uniform(0.7, 1.2)
    noisy = exposed + rng.normal(0, 3, exposed.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def error_of(found: Matrix3, truth: Matrix3) -> float:
    """Return the mean distance of a grid of the frame from its true place, in map pixels."""
    x, y = (np.linspace(0, side - 1, 9) for side in SIZE)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    apart = transform(found, grid) - transform(truth, grid)
    return float(np.linalg.norm(apart, axis=1).mean())


def flown(
    map_: nearfar.maps.map.Map, frames: Iterator[MadeFrame], alone: int
) -> Iterator[dict[str, Any]]:
    """Yield a row for each frame."""
    located = 0
    with Tracker(map_) as tracker:
        for index, frame in enumerate(frames):
            began = time.process_time()
            state = tracker.update(frame.pixels, index / RATE)
            row: dict[str, Any] = {
                "index": index,
                "hidden": frame.hidden,
                "status": state.status,
                "step": state.step,
                "confidence": state.confidence,
                "expected_error": state.expected_error,
                "inliers": state.inliers,
                "cpu_seconds": time.process_time() - began,
            }
            if state.far_from_near is not None and state.covariance is not None:
                row["error"] = error_of(state.far_from_near, frame.map_from_frame)
                row["deviation"] = float(np.sqrt(np.diag(state.covariance)[:2].mean()))
            if index % ALONE_EACH == 0 and not frame.hidden and located < alone:
                located += 1
                began = time.process_time()
                found = map_.locate(frame.pixels)
                row["alone_cpu_seconds"] = time.process_time() - began
                if found.answers:
                    model = np.asarray(found.answers[0].far_from_near)
                    row["alone_error"] = error_of(model, frame.map_from_frame)
                    row["alone_confidence"] = found.answers[0].confidence
            yield row


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of a flight."""
    shown = [row for row in rows if not row["hidden"]]
    known = [row for row in shown if row["status"] in ("tracked", "relocalized")]
    errors = np.array([row["error"] for row in known])
    alone = [row for row in rows if "alone_cpu_seconds" in row]
    alone_errors = np.array([row["alone_error"] for row in alone if "alone_error" in row])
    cpu = float(np.mean([row["cpu_seconds"] for row in rows]))
    wrong = [
        row
        for row in rows
        if row["confidence"] >= 0.5 and (row["hidden"] or row["error"] > CORRECT)
    ]
    tracked = [row["cpu_seconds"] for row in rows if row["status"] == "tracked"]
    return {
        "frames": len(rows),
        "shown": len(shown),
        "matched": len(known),
        "rmse": float(np.sqrt((errors**2).mean())),
        "within_3": float((errors <= CORRECT).sum() / len(shown)),
        "placed_within_3": sum(row.get("error", np.inf) <= CORRECT for row in shown) / len(shown),
        "confident_and_wrong": len(wrong),
        "cpu_seconds": cpu,
        "tracked_cpu_seconds": float(np.median(tracked)),
        "alone": len(alone),
        "alone_rmse": float(np.sqrt((alone_errors**2).mean())) if len(alone_errors) else None,
        "alone_within_3": float((alone_errors <= CORRECT).sum() / max(1, len(alone))),
        "alone_cpu_seconds": float(np.mean([row["alone_cpu_seconds"] for row in alone]))
        if alone
        else None,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("orthophoto", type=Path)
    parser.add_argument("--other", type=Path, required=True, help="an unrelated photograph")
    parser.add_argument(
        "--centres",
        type=float,
        nargs=4,
        required=True,
        metavar=("LEFT", "TOP", "RIGHT", "BOTTOM"),
        help="where the centres of the frames lie, in pixels of the orthophoto",
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--alone", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    shutil.rmtree(asked.out, ignore_errors=True)
    asked.out.mkdir(parents=True)
    orthophoto = read_image(asked.orthophoto).pixels
    Image.fromarray(orthophoto).save(asked.out / "orthophoto.png")
    map_ = nearfar.open_map(asked.out / "map", create=True)
    map_.add([asked.out / "orthophoto.png"])
    rng = np.random.default_rng(asked.seed)
    other = read_image(asked.other).pixels
    left, top, right, bottom = asked.centres
    frames = made_frames(orthophoto, other, (left, top, right, bottom), asked.frames, rng)
    rows = []
    with (asked.out / "frames.jsonl").open("w") as out:
        for row in flown(map_, frames, asked.alone):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
