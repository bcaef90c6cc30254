"""Peak memory and time of `paper` with `hog` on a pair with a far image of 12 and 100 megapixels.

Run with `python benchmarks/memory.py`; each pair runs in a process of its own.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from skimage import data

import nearfar

SIZES = {"12 megapixels": (4000, 3000), "100 megapixels": (11600, 8700)}


def make_pair(folder: Path, size: tuple[int, int]) -> tuple[Path, Path]:
    """A wall of photographs of so many pixels, and one of its photographs at 12 megapixels."""
    coffee, cat = data.coffee()[:300, :400, ::-1], data.chelsea()[:300, :400, ::-1]
    wall = np.vstack([np.hstack([coffee, cat, cat]), np.hstack([cat, cat, cat])])
    far, near = folder / "far.jpg", folder / "near.jpg"
    cv2.imwrite(str(far), cv2.resize(wall, size, interpolation=cv2.INTER_CUBIC))
    cv2.imwrite(str(near), cv2.resize(coffee, (4000, 3000), interpolation=cv2.INTER_CUBIC))
    return far, near


def measure(far: str, near: str) -> None:
    """Localize one pair and print what it took."""
    found = nearfar.localize(far, near, method="paper", descriptor="hog")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    seconds = sum(found.seconds.values())
    print(json.dumps({"status": found.status, "seconds": seconds, "peak_megabytes": peak}))


def main() -> None:
    """Measure every size in a process of its own."""
    for name, size in SIZES.items():
        with tempfile.TemporaryDirectory() as folder:
            far, near = make_pair(Path(folder), size)
            command = [sys.executable, __file__, str(far), str(near)]
            print(name, subprocess.run(command, check=True, capture_output=True, text=True).stdout)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        measure(*sys.argv[1:])
    else:
        main()
