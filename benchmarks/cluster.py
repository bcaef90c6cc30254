"""What a second worker gains, and what a cluster costs, on KITTI pairs.

    python benchmarks/cluster.py KITTI SCRATCH [--sample 60] [--method sift-tuned] [--repeats 3]

The same pairs with one and with two worker processes of a Dask cluster on this machine, and with
two local processes; all have one thread each and are warm. The least of the repeats counts. Also
how many results pass through the scheduler when a map is built. SCRATCH is made and removed.
"""

import argparse
import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nearfar import open_map
from nearfar.bench.cases import Case
from nearfar.bench.kitti import find_kitti_cases
from nearfar.bench.run import run
from nearfar.bench.workers import Workers
from nearfar.cli.bench.options import sampled
from nearfar.settings import Settings


@contextmanager
def cluster(workers: int) -> Iterator[Any]:
    """A scheduler and worker processes with one thread each."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as started:
        yield started


def least(repeats: int, action: Callable[[Path], object], scratch: Path) -> float:
    """Seconds of the fastest of several repeats, each into a folder of its own."""
    seconds = []
    for number in range(repeats + 1):
        folder = scratch / str(number)
        begun = time.perf_counter()
        action(folder)
        seconds.append(time.perf_counter() - begun)
        shutil.rmtree(folder)
    return min(seconds[1:])  # The first one warms up.


def compared(
    cases: list[Case], settings: Settings, scratch: Path, repeats: int
) -> dict[str, float]:
    """Seconds with each kind of workers."""

    def with_workers(workers: Workers) -> float:
        def once(folder: Path) -> object:
            return run(cases, [settings], folder / "kitti.jsonl", workers=workers)

        return least(repeats, once, scratch)

    found = {"two local processes": with_workers(Workers(2))}
    for count in (1, 2):
        with cluster(count) as started:
            workers = Workers(scheduler=started.scheduler_address)
            found[f"cluster, {count} workers"] = with_workers(workers)
    return found


def through_scheduler(images: list[Path], scratch: Path) -> dict[str, int]:
    """How many images a map was built of, and how many results passed through the scheduler."""
    passed = 0
    with cluster(2) as started:
        handlers = started.scheduler.handlers
        gather = handlers["gather"]

        async def counted(*given: Any, **named: Any) -> Any:
            nonlocal passed
            passed += 1
            return await gather(*given, **named)

        handlers["gather"] = counted
        town = open_map(scratch / "map", create=True)
        added = town.add(images, scheduler=started.scheduler_address)
    return {"images": added.added, "results through the scheduler": passed}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kitti", type=Path)
    parser.add_argument("scratch", type=Path)
    parser.add_argument("--sample", type=int, default=60)
    parser.add_argument("--method", default="sift-tuned")
    parser.add_argument("--repeats", type=int, default=3)
    asked = parser.parse_args()
    asked.scratch.mkdir(parents=True)
    cases = sampled(find_kitti_cases(asked.kitti), asked.sample, 0)
    images = sorted({case.far for case in cases})[:20]
    try:
        found = compared(cases, Settings(method=asked.method), asked.scratch, asked.repeats)
        one, two = found["cluster, 1 workers"], found["cluster, 2 workers"]
        print(
            json.dumps(
                {
                    "pairs": len(cases),
                    "method": asked.method,
                    "seconds": {name: round(value, 2) for name, value in found.items()},
                    "two workers over one": round(one / two, 2),
                    "cluster over local processes": round(two / found["two local processes"], 3),
                    "map": through_scheduler(images, asked.scratch),
                }
            )
        )
    finally:
        shutil.rmtree(asked.scratch)


if __name__ == "__main__":
    main()
