"""What a second worker gains, and what a cluster costs, on KITTI pairs.

    python benchmarks/cluster.py KITTI SCRATCH [--sample 300] [--method sift-tuned] [--repeats 1]

The same pairs with one and with two worker processes of a Dask cluster on this machine, and with
two local processes; all have one thread each, are warm, and share a feature store that is empty at
first, as with `nearfar bench kitti`. The least of the repeats counts. Also how many results pass
through the scheduler when a map is built of --map-images frames. SCRATCH is made and removed.
"""

import argparse
import itertools
import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nearfar import open_map
from nearfar.bench.datasets.cases import Case
from nearfar.bench.runner import run
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.cli.bench.options import sampled
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings

LOCAL, ONE, TWO = "two local processes", "cluster, one worker", "cluster, two workers"
WARMING = 8
"""Pairs that the workers have done before time is taken."""


@contextmanager
def cluster(workers: int) -> Iterator[Any]:
    """A scheduler and worker processes with one thread each."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as started:
        yield started


def compared(
    cases: list[Case], settings: Settings, scratch: Path, repeats: int
) -> dict[str, float]:
    """Seconds with each kind of workers, which take turns."""
    numbers = itertools.count()

    def seconds(workers: Workers, some: list[Case]) -> float:
        folder = scratch / str(next(numbers))
        begun = time.perf_counter()
        run(some, [settings], folder / "kitti.jsonl", workers=workers, features=folder / "features")
        taken = time.perf_counter() - begun
        shutil.rmtree(folder)
        return taken

    with cluster(1) as one, cluster(2) as two:
        kinds = {
            LOCAL: Workers(2),
            ONE: Workers(scheduler=one.scheduler_address),
            TWO: Workers(scheduler=two.scheduler_address),
        }
        found = dict.fromkeys(kinds, float("inf"))
        for some in [cases[:WARMING]] + repeats * [cases]:
            for name, workers in kinds.items():
                taken = seconds(workers, some)
                if some is cases:
                    found[name] = min(found[name], taken)
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
        map_ = open_map(scratch / "map", create=True)
        added = map_.add(images, scheduler=started.scheduler_address)
    return {"images": added.added, "results through the scheduler": passed}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kitti", type=Path)
    parser.add_argument("scratch", type=Path)
    parser.add_argument("--sample", type=int, default=300)
    parser.add_argument("--method", default="sift-tuned")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--map-images", type=int, default=20)
    asked = parser.parse_args()
    asked.scratch.mkdir(parents=True)
    cases = sampled(find_kitti_cases(asked.kitti), asked.sample, 0)
    images = sorted({case.far for case in cases})[: asked.map_images]
    try:
        found = compared(cases, Settings(method=asked.method), asked.scratch, asked.repeats)
        print(
            json.dumps(
                {
                    "pairs": len(cases),
                    "method": asked.method,
                    "seconds": {name: round(value, 2) for name, value in found.items()},
                    "two workers over one": round(found[ONE] / found[TWO], 2),
                    "cluster over local processes": round(found[TWO] / found[LOCAL], 3),
                    "map": through_scheduler(images, asked.scratch),
                }
            )
        )
    finally:
        shutil.rmtree(asked.scratch)


if __name__ == "__main__":
    main()
