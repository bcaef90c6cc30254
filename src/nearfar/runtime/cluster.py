"""A Dask cluster as workers: connection, number of threads, and a check of package versions."""

import importlib.metadata
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from nearfar.errors import ClusterError

CONNECTION_SECONDS = 20
"""Seconds that a scheduler may take to answer."""
WORKER_SECONDS = 120
"""Seconds that a scheduler may be without workers when tasks are submitted."""
DEAD_AFTER = "5s"
"""Time after which a worker that does not answer counts as dead."""
COUNTED_EVERY = 5.0
"""Seconds between two counts of the workers, which may come and go."""
PACKAGES = (
    "nearfar",
    "numpy",
    "opencv-contrib-python-headless",
    "onnxruntime",
    "pillow",
    "poselib",
    "lancedb",
)
"""Packages that must have the same version everywhere, since they can change a result."""


class Threads:
    """Counts the threads of a cluster."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._count, self._next = 1, 0.0

    def __call__(self) -> int:
        """Return the number of threads, at most `COUNTED_EVERY` seconds old."""
        if time.monotonic() >= self._next:
            self._count = max(1, sum(self._client.nthreads().values()))
            self._next = time.monotonic() + COUNTED_EVERY
        return self._count


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to the scheduler at an address, and yield the client.

    Raises:
        ClusterError: the scheduler cannot be reached, has no workers, or they have other versions.
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
        check_versions(client)
        yield client


def check_versions(client: Any) -> None:
    """Refuse workers whose packages could give other results."""
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
    """Return the versions of the installed `PACKAGES` of this process."""
    found = {}
    for name in PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found
