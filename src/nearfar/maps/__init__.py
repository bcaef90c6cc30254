"""Maps of many images, in which other images are located. Needs the extra `map`."""

from os import PathLike
from typing import TYPE_CHECKING, Any

from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import Url, location

if TYPE_CHECKING:
    from nearfar.maps.map import Map

PACKAGES = ("lancedb", "pyarrow", "joblib", "filelock")
"""Packages of the extra `map`."""
DEFAULTS = Settings(max_effort="points")
"""Default settings of the method that verifies candidates."""


def open_map(
    path: str | PathLike[str] | Url,
    *,
    create: bool = False,
    max_size: int | None = None,
    settings: Settings = DEFAULTS,
    **options: Any,
) -> "Map":
    """Open a map.

    Args:
        path: folder of the map, or its URL in object storage (s3://BUCKET/PATH).
        create: whether to make a map without images where there is none.
        max_size: longest side in pixels to which a new map reduces images; 0, the default, does
            not reduce them. A map that was made with another value is refused.
        settings: settings of the method `adaptive`, and the weights of the descriptor.
        **options: settings to change, by name.

    Raises:
        MapError: there is no map, the folder holds something else, or the map has another format
            or `max_size`.
        MissingExtraError: packages of the extra `map` are not installed.
        SettingsError: an option is unknown or out of range.
        StorageError: object storage does not answer or refuses.
        WeightsError: a new map needs the weights of the descriptor, and they cannot be read.
    """
    require("map", *PACKAGES)
    from nearfar.maps.map import Map

    folder, chosen = location(path), settings.replace(**options)
    if create and not Map.exists(folder):
        return Map.create(folder, chosen, max_size or 0)
    found = Map(folder, chosen)
    found.manifest.check_max_size(max_size, folder)
    return found
