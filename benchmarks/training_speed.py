"""Seconds of a batch in a training, its making included.

    python benchmarks/training_speed.py PHOTOS [--jobs 1]

Run it with and without the environment variables of docs/descriptor.md. Needs the extra `train`.
"""

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path

from nearfar.storage.rows import Row
from nearfar.train.photographs import read_photographs
from nearfar.train.training import FULL, train
from nearfar.train.training_set import TrainingSet

STEPS, FIRST = 60, 20
"""Of the training; those before the first to be timed fill queues and memory."""


def main() -> None:
    """Train for a minute and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    photographs, _ = read_photographs([asked.photographs])
    ended: list[float] = []

    def progress(_step: int, _row: Row | None) -> None:
        ended.append(time.perf_counter())

    with tempfile.TemporaryDirectory() as out:
        configuration = dataclasses.replace(FULL, steps=STEPS)
        everything, nothing = TrainingSet(photographs), TrainingSet([])
        train(everything, nothing, configuration, Path(out), jobs=asked.jobs, progress=progress)
    print(f"{(ended[-1] - ended[FIRST - 1]) / (STEPS - FIRST):.2f} s a batch")


if __name__ == "__main__":
    main()
