"""Typed exceptions; each message is one sentence that says what to do next.

A pair that cannot be localized is not an error: it is a `Localization` whose status is "failed".
"""


class NearfarError(Exception):
    """Base of every error that nearfar raises on purpose; the command line exits with status 2."""


class ImageError(NearfarError):
    """An image is missing, unreadable, truncated, of an unknown format or over a size limit."""


class IntrinsicsError(NearfarError):
    """Camera intrinsics are missing, malformed or not finite."""


class SettingsError(NearfarError):
    """A setting has an unknown name or a value out of range."""


class WeightsError(NearfarError):
    """Network weights are missing, unreadable or do not fit the network."""


class BenchmarkError(NearfarError):
    """A benchmark's data are missing or malformed."""


class TrainingError(NearfarError):
    """There is too little to train on, or a folder holds another training."""


class MapError(NearfarError):
    """A map is missing, of another kind, in use, or an image of it is unknown."""


class ClusterError(NearfarError):
    """A Dask cluster cannot be reached, has no workers, or has workers of other versions."""


class ExternalMethodError(NearfarError):
    """A matcher that was named by `python:module.function` raised an exception."""


class MissingExtraError(NearfarError):
    """A package of an optional extra is not installed."""


class StorageError(NearfarError):
    """Object storage does not answer, refuses, or cannot do what is needed."""


class ExportError(NearfarError):
    """A format has no place for a localization, e.g. a list of poses for a homography."""
