"""Read damaged files of every kind, and report refusals, errors, times and memory.

Run: python -m benchmarks.damaged_files --count 2000
"""

import argparse
import resource
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.imaging.damage import damaged_files

from nearfar.errors import ImageError
from nearfar.imaging.image import read_image

MOST_PIXELS = 10**6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    outcomes: Counter[str] = Counter()
    slowest, which = 0.0, ""
    before = _peak_megabytes()
    with tempfile.TemporaryDirectory() as folder:
        for name, file in damaged_files(Path(folder), asked.count, asked.seed):
            begun = time.perf_counter()
            outcome = _outcome(file, name)
            outcomes[outcome] += 1
            took = time.perf_counter() - begun
            if took > slowest:
                slowest, which = took, name
    for outcome, number in sorted(outcomes.items()):
        print(f"{outcome}: {number}")
    print(f"slowest: {slowest:.2f} s ({which})")
    print(f"peak memory: {before:.0f} MB before, {_peak_megabytes():.0f} MB after")


def _outcome(file: Path, name: str) -> str:
    try:
        read_image(file, max_pixels=MOST_PIXELS)
    except ImageError:
        return "refused"
    except Exception as error:
        print(f"{name}: {type(error).__name__}: {error}")
        return "other error"
    return "read"


def _peak_megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
