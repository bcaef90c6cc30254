"""Threads of one process: pieces of work side by side, with results that do not depend on it.

OpenCV, ONNX Runtime and numpy let other threads run while they compute. The number of threads is
OpenCV's (`cv2.getNumThreads`), which batches set to one in each of their processes.
"""

import functools
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from contextvars import copy_context
from typing import Any, TypeVar

import cv2
from threadpoolctl import ThreadpoolController

from nearfar.errors import SettingsError

T = TypeVar("T")
R = TypeVar("R")


def use_threads(count: int) -> None:
    """Let this process use so many threads for one pair of images.

    Args:
        count: of OpenCV, and of ONNX Runtime in sessions that begin later.

    Raises:
        SettingsError: it is less than 1.
    """
    if count < 1:
        raise SettingsError(f"--threads must be at least 1, not {count}")
    cv2.setNumThreads(count)
    os.environ["OMP_NUM_THREADS"] = str(count)


def blas_on_one_thread() -> AbstractContextManager[Any]:
    """Let numpy's matrix products in the enclosed block take one thread each.

    They are small here: more threads took a third more CPU time, and no less time.
    """
    limited: AbstractContextManager[Any] = _linear_algebra().limit(limits=1, user_api="blas")
    return limited


@functools.cache
def _linear_algebra() -> ThreadpoolController:
    return ThreadpoolController()


def in_order(function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Yield `function(item)` for each item in order, computed by several threads.

    What `function` raises is raised where its result is due. Work that has not begun when the
    caller stops is left out. The deadline of the caller holds in the threads too.

    Args:
        function: must not change what others of its calls read.
        items: few; all are submitted at once.
    """
    threads = cv2.getNumThreads()
    waiting = list(items)
    if threads < 2 or len(waiting) < 2:
        yield from map(function, waiting)
        return
    with ThreadPoolExecutor(min(threads, len(waiting))) as pool:
        due: list[Future[R]] = [pool.submit(copy_context().run, function, item) for item in waiting]
        try:
            for each in due:
                yield each.result()
        finally:
            pool.shutdown(cancel_futures=True)
