"""Builds of a map that are killed at random moments and begun again, compared with one in peace.

    python benchmarks/map_kills.py PHOTOGRAPHS OUT [--kills 20] [--images 40]

Each time a new map of the photographs is built, killed (SIGKILL) at a moment drawn evenly from the
time that the build in peace took, checked, and built again to its end. Then it must have no
problems and answer queries, the middles of some photographs, with the same bytes as the map built
in peace. One JSON object a kill; exit status 1 where a map differs.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from nearfar import open_map
from nearfar.imaging.image import read_image
from nearfar.maps.map import Map

QUERIES = 4


def building(folder: Path, photographs: Sequence[Path]) -> subprocess.Popen[bytes]:
    """A process that builds the map."""
    command = [sys.executable, "-m", "nearfar", "map", "build", *map(str, photographs)]
    return subprocess.Popen(
        [*command, "--out", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def seconds_to_build(folder: Path, photographs: Sequence[Path]) -> float:
    """Build the map to its end."""
    start = time.perf_counter()
    if building(folder, photographs).wait():
        raise SystemExit(f"the build of {folder} failed")
    return time.perf_counter() - start


def killed(folder: Path, photographs: Sequence[Path], after: float) -> None:
    """Begin to build the map and kill the process and its children."""
    process = building(folder, photographs)
    time.sleep(after)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def middle_of(photograph: Path, folder: Path) -> Path:
    """The middle of a photograph as a query."""
    pixels = read_image(photograph).pixels
    height, width = (side // 4 for side in pixels.shape[:2])
    file = folder / f"{photograph.stem}.png"
    Image.fromarray(pixels[height:-height, width:-width]).save(file)
    return file


def answers(map_: Map, queries: Sequence[Path]) -> list[dict[str, Any]]:
    """What the map answers, without times."""
    found = [map_.locate(query).to_dict() for query in queries]
    for each in found:
        del each["seconds"]
    return found


def images_left(folder: Path) -> int | None:
    """Images of the map that a killed build left; None where it left none that opens."""
    return len(open_map(folder).images) if Map.exists(folder) else None


def main() -> None:
    """Build in peace, then kill and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photographs", type=Path, help="a folder")
    parser.add_argument("out", type=Path, help="a folder to work in")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--images", type=int, default=40)
    asked = parser.parse_args()
    photographs = sorted(asked.photographs.glob("*.jpg"))[: asked.images]
    (asked.out / "queries").mkdir(parents=True, exist_ok=True)
    chosen = photographs[:: max(1, len(photographs) // QUERIES)]
    queries = [middle_of(photograph, asked.out / "queries") for photograph in chosen]
    for name in ("peace", "war"):
        shutil.rmtree(asked.out / name, ignore_errors=True)
    folder = asked.out / "war"
    duration = seconds_to_build(asked.out / "peace", photographs)
    expected = answers(open_map(asked.out / "peace"), queries)
    rng = np.random.default_rng(0)
    same = 0
    for kill in range(asked.kills):
        after = float(rng.uniform(0, duration))
        killed(folder, photographs, after)
        left = images_left(folder)
        seconds_to_build(folder, photographs)
        map_ = open_map(folder)
        problems = [str(problem) for problem in map_.check()]
        equal = not problems and answers(map_, queries) == expected
        same += equal
        row = {"kill": kill, "after": after, "left": left, "problems": problems, "same": equal}
        print(json.dumps(row), flush=True)
        shutil.rmtree(folder)
    located = sum(each["status"] == "located" for each in expected)
    print(f"in peace: {duration:.1f} s, {located} of {len(queries)} queries located")
    print(f"{same} of {asked.kills} maps like the one built in peace")
    raise SystemExit(same < asked.kills)


if __name__ == "__main__":
    main()
