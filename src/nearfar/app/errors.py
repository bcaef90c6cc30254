"""Errors of the app, which know nothing of HTTP: `server.STATUSES` maps them to statuses.

NearfarError
└── AppError
├── NotFoundError       a file, job, annotation or result is not there
├── ConflictError       the request contradicts what the app holds
├── TooLargeError       an image, or the results of a benchmark, are over a limit
├── IncompleteError     an upload was broken off
├── StoreFullError      there is no room for more images or annotations
└── TryLaterError
├── BusyError       too much is under way at this moment
└── QueueFullError  too many jobs are waiting
"""

from nearfar.errors import NearfarError


class AppError(NearfarError):
    """Base class of the errors of the app; the message names no folder of this machine."""


class NotFoundError(AppError):
    """A file, job, annotation or result is not there, or not in the served folders."""


class ConflictError(AppError):
    """A request contradicts what the app holds, e.g. a name that is taken."""


class TooLargeError(AppError):
    """An image that is sent, or the results of a benchmark, are over a limit."""


class IncompleteError(AppError):
    """An image that is sent was broken off."""


class StoreFullError(AppError):
    """There is no room for more images or annotations."""


class TryLaterError(AppError):
    """The app has too much to do; the same request may succeed later.

    Attributes:
        retry_after: seconds after which it is worth trying again.
    """

    retry_after = 1


class BusyError(TryLaterError):
    """Too many requests of one kind are under way at this moment."""


class QueueFullError(TryLaterError):
    """Too many jobs are waiting."""

    retry_after = 5
