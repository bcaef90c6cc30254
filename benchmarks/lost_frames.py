"""Measure how long lost frames take against their budget.

    python benchmarks/lost_frames.py ORTHOPHOTO --other OTHER [--other ...] --out lost

A made flight over ORTHOPHOTO (see `flight.py`) is followed for 20 frames. Then come 40 frames of
unrelated photographs, the parts of OTHER, which lie nowhere in the map. For each budget the table
has the longest and the mean wall time of these frames and of the tracked ones, in seconds, and the
longest of lost frames as a share of the budget.
"""

import argparse
import itertools
import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

import nearfar
from flight import SIZE, made_frames
from nearfar.arrays import RGBPixels
from nearfar.imaging.image import read_image
from nearfar.tracking import Tracker

FOLLOWED, LOST = 20, 40


def unrelated(photographs: list[RGBPixels], count: int) -> Iterator[RGBPixels]:
    """Yield parts of photographs, each of the size of a frame."""
    rng = np.random.default_rng(0)
    for photograph in itertools.islice(itertools.cycle(photographs), count):
        room = np.array(photograph.shape[1::-1]) - SIZE
        left, top = (int(rng.integers(0, max(1, side))) for side in room)
        yield np.ascontiguousarray(photograph[top : top + SIZE[1], left : left + SIZE[0]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("orthophoto", type=Path)
    parser.add_argument("--other", type=Path, action="append", required=True)
    parser.add_argument("--centres", type=float, nargs=4, default=(180, 390, 1640, 600))
    parser.add_argument("--budgets", type=float, nargs="+", default=(0.5, 1.0, 3.0, math.inf))
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    shutil.rmtree(asked.out, ignore_errors=True)
    asked.out.mkdir(parents=True)
    orthophoto = read_image(asked.orthophoto).pixels
    others = [read_image(each).pixels for each in asked.other]
    Image.fromarray(orthophoto).save(asked.out / "orthophoto.png")
    map_ = nearfar.open_map(asked.out / "map", create=True)
    map_.add([asked.out / "orthophoto.png"])
    left, top, right, bottom = asked.centres
    rng = np.random.default_rng(0)
    every = made_frames(orthophoto, others[0], (left, top, right, bottom), 2 * FOLLOWED, rng)
    shown = [each.pixels for each in every if not each.hidden][:FOLLOWED]
    for budget in asked.budgets:
        with Tracker(map_, budget=budget) as tracker:
            known = [tracker.update(frame) for frame in shown]
            lost = [tracker.update(frame) for frame in unrelated(others, LOST)]
        tracked = [each.seconds for each in known if each.status == "tracked"]
        seconds = [each.seconds for each in lost]
        row = {
            "budget": budget,
            "tracked": len(tracked),
            "tracked_mean": float(np.mean(tracked)),
            "tracked_longest": max(tracked),
            "not_found": sum(not each.known for each in lost),
            "mean": float(np.mean(seconds)),
            "longest": max(seconds),
            "longest_of_budget": max(seconds) / budget,
        }
        print(json.dumps(row))


if __name__ == "__main__":
    main()
