"""Reasons of tasks that fail, so that a run of many tasks goes on."""

import errno

from nearfar.errors import NearfarError

DIED = "the process that computed it died"
"""Reason of a task that killed every worker that took it."""


def reason_of_error(error: Exception) -> str:
    """Return why a task failed, in one line.

    Args:
        error: the exception that the task raised; libraries raise any kind for a damaged image.

    Raises:
        OSError: the error itself, where the disk is full, which no other task would survive.
    """
    if isinstance(error, NearfarError):
        return " ".join(str(error).split())
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        raise error
    return " ".join(f"{type(error).__name__}: {error}".split())
