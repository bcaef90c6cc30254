"""CPU seconds of one pair by stage, for one source tree or several, side by side.

    python benchmarks/speed.py FAR NEAR SOURCE [SOURCE ...] [--max-size 1200] [--rounds 1]
        [--all-cores]

SOURCE is the folder of a source tree. Each runs in processes of its own with one thread, in turns,
so that other work on the machine hits all alike. With --all-cores each has the threads that it
takes by default. The table has medians; its last rows are the whole, its wall time, and the whole
over a fixed reference computation, SIFT on noise of 1200x900 pixels. Compare these ratios between
machines and days, and seconds only within one run.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SIZE = (900, 1200, 3)
"""Rows, columns and channels of the noise."""


def measured(far: str, near: str, max_size: int) -> dict[str, Any]:
    """Return the CPU seconds of a pair by stage, and of the reference computation."""
    import numpy as np

    import nearfar
    from nearfar.features.detection import detect_rootsift
    from nearfar.runtime.timing import StageTimer

    @contextmanager
    def stage(self: Any, name: str) -> Iterator[None]:
        start = time.process_time()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - start

    StageTimer.stage = stage  # type: ignore[method-assign]  # In this process alone.
    noise = np.random.default_rng(0).integers(0, 256, SIZE, np.uint8)
    start = time.process_time()
    detect_rootsift(noise)
    reference = time.process_time() - start
    localizer = nearfar.Localizer(max_size=max_size)
    start, began = time.process_time(), time.perf_counter()
    found = localizer.localize(far, near)
    whole, wall = time.process_time() - start, time.perf_counter() - began
    return {
        "answer": f"{found.status} by {found.step}",
        "stages": found.seconds
        | {"all": whole, "wall": wall, "all / reference": whole / reference},
    }


def run(source: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure one source tree in a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(Path(source).absolute() / "src")}
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        environment.pop(name, None)
        if not arguments.all_cores:
            environment[name] = "1"
    command = [sys.executable, __file__, arguments.far, arguments.near, "--measure"]
    command += ["--max-size", str(arguments.max_size)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def table(results: dict[str, list[dict[str, Any]]]) -> str:
    """Return a Markdown table: a row a stage, a column a source tree."""
    names = {name for rounds in results.values() for each in rounds for name in each["stages"]}
    ends = ["all", "wall", "all / reference"]
    lines = ["| stage | " + " | ".join(results) + " |", "|---" * (1 + len(results)) + "|"]
    for name in [*sorted(names.difference(ends)), *ends]:
        cells = [
            f"{statistics.median(each['stages'].get(name, 0.0) for each in rounds):.2f}"
            for rounds in results.values()
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    answers = " | ".join(rounds[0]["answer"] for rounds in results.values())
    return "\n".join([*lines, f"| answer | {answers} |"])


def main() -> None:
    """Parse the command line; measure, or print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("far")
    parser.add_argument("near")
    parser.add_argument("sources", nargs="*")
    parser.add_argument("--max-size", type=int, default=1200)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--all-cores", action="store_true", help="the threads of the default")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(measured(arguments.far, arguments.near, arguments.max_size)))
        return
    results: dict[str, list[dict[str, Any]]] = {each: [] for each in arguments.sources}
    for _ in range(arguments.rounds):
        for source in results:
            results[source].append(run(source, arguments))
    print(table(results))


if __name__ == "__main__":
    main()
