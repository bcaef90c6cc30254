"""A Dask cluster as workers: its scheduler, its threads, and whether it has the same packages."""

import importlib.metadata
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from nearfar.errors import ClusterError

CONNECTION_SECONDS = 20
"""How long a scheduler may take to answer."""
WORKER_SECONDS = 120
"""How long it may be without workers when tasks are to be handed out, also after a death."""
DEAD_AFTER = "5s"
"""How long a worker that does not answer is asked for a result."""
COUNTED_EVERY = 5.0
"""Seconds between two looks at how many workers there are; they may come and go."""
PACKAGES = (
    "nearfar",
    "numpy",
    "opencv-contrib-python-headless",
    "onnxruntime",
    "pillow",
    "poselib",
    "lancedb",
)
"""That must be the same everywhere, since they can change a result."""


class Threads:
    """How many threads a cluster has by now."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._count, self._next = 1, 0.0

    def __call__(self) -> int:
        """How many there are, as of a few seconds ago."""
        if time.monotonic() >= self._next:
            self._count = max(1, sum(self._client.nthreads().values()))
            self._next = time.monotonic() + COUNTED_EVERY
        return self._count


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of the scheduler at an address, which has workers.

    Raises:
        ClusterError: it is not there, has no workers, or they have other versions.
    """
    import dask
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECTION_SECONDS, direct_to_workers=True)
    except (OSError, ValueError) as error:
        raise ClusterError(f"the scheduler {address} cannot be reached: {error}") from error
    with client, dask.config.set({"distributed.comm.timeouts.connect": DEAD_AFTER}):
        try:
            client.wait_for_workers(1, timeout=WORKER_SECONDS)
        except TimeoutError:
            raise ClusterError(
                f"the scheduler {address} has no workers: start some with `dask worker {address} "
                f"--nthreads 1`"
            ) from None
        _check_versions(client)
        yield client


def _check_versions(client: Any) -> None:
    """Refuse workers that might find something else."""
    own = versions()
    for worker, found in client.run(versions).items():
        for package, version in own.items():
            if found.get(package) != version:
                there = found.get(package, "(none)")
                raise ClusterError(
                    f"the worker {worker} has {package} {there}, here it is {version}: "
                    f"install the same everywhere"
                )


def versions() -> dict[str, str]:
    """The versions of those of `PACKAGES` that this process has."""
    found = {}
    for name in PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found
