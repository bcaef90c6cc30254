"""Exceptions that nearfar raises on purpose.

Each message is one sentence: what is wrong with which input, then what to do.

    Exception
    └── NearfarError
        ├── ImageError
        ├── IntrinsicsError
        ├── SettingsError
        ├── WeightsError
        ├── MapError
        ├── LocalizationError
        ├── ExportError
        ├── StorageError
        ├── ClusterError
        ├── MissingExtraError
        ├── ExternalMethodError
        ├── BenchmarkError
        └── TrainingError

The command line prints the message of a `NearfarError` and ends with exit status 2. A pair that
cannot be localized is not an error: it is a `Localization` with the status "failed".
"""


class NearfarError(Exception):
    """Base class of every error that nearfar raises on purpose."""


class ImageError(NearfarError):
    """An image is missing, unreadable, truncated, of an unknown format or over a size limit."""


class IntrinsicsError(NearfarError):
    """Camera intrinsics are missing, malformed or not finite."""


class SettingsError(NearfarError):
    """A setting, or an option of a command, has an unknown name or a value out of range."""


class WeightsError(NearfarError):
    """Network weights are missing, unreadable or do not fit the network."""


class MapError(NearfarError):
    """A map is missing, in use or of another format, or it does not hold an image."""


class LocalizationError(NearfarError):
    """What was kept of a localization is damaged and cannot be read back."""


class ExportError(NearfarError):
    """A format cannot hold a localization, e.g. a list of poses cannot hold a homography."""


class StorageError(NearfarError):
    """Object storage does not answer, refuses a request or lacks a feature that is needed."""


class ClusterError(NearfarError):
    """A Dask cluster cannot be reached, has no workers, or has workers of other versions."""


class MissingExtraError(NearfarError):
    """A package of an optional extra is not installed."""


class ExternalMethodError(NearfarError):
    """A matcher, or a detector, of the user or another package raised an exception."""


class BenchmarkError(NearfarError):
    """The data of a benchmark are missing or malformed."""


class TrainingError(NearfarError):
    """There are too few photographs to train on, or a folder holds another training."""
