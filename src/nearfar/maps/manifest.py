"""The manifest of a map: the format, descriptor and image size that it was made with."""

import dataclasses
import hashlib
import importlib.metadata
import json
from dataclasses import dataclass
from pathlib import Path

from nearfar.errors import MapError
from nearfar.networks.landmark_network import landmark_network
from nearfar.settings import Settings
from nearfar.storage.locations import Location, replaced

FILE = "nearfar-map.json"
FORMAT = 2
"""Version of the tables; it changes with every constant that changes what they store."""
OLDEST = 1
"""Oldest format that can be upgraded; see `creation.upgrade`."""
DESCRIPTOR = "nearfar"


@dataclass(frozen=True)
class Manifest:
    """What a map was made with.

    Attributes:
        format: version of the format.
        nearfar: version of nearfar that made the map.
        descriptor: name of the landmark descriptor.
        model: SHA-256 of the network of the descriptor.
        max_size: longest side to which images were reduced, in pixels; 0: not reduced.
        bands: bands of the images that are shown as red, green and blue; empty: those that each
            file names.
    """

    format: int
    nearfar: str
    descriptor: str
    model: str
    max_size: int
    bands: str = ""

    def write(self, folder: Location) -> None:
        """Write the manifest into the folder of a map, or replace the one there as a whole.

        Raises:
            OSError: the file cannot be written.
        """
        text = json.dumps(dataclasses.asdict(self), indent=1) + "\n"
        if isinstance(folder, Path):
            with replaced(folder / FILE) as incomplete:
                incomplete.write_text(text, encoding="utf-8")
        else:
            (folder / FILE).write_text(text, encoding="utf-8")

    def check_max_size(self, asked: int | None, folder: Location) -> None:
        """Check that images were reduced to the size that is asked for; None fits any.

        Raises:
            MapError: they were reduced to another size.
        """
        if asked not in (None, self.max_size):
            raise MapError(
                f"the map {folder} was made with a max_size of {self.max_size}, not {asked}: leave "
                f"max_size out, or build another map"
            )

    def check_model(self, settings: Settings, folder: Location) -> None:
        """Check that the map was made with the descriptor of the settings.

        Raises:
            MapError: the map was made with another descriptor.
            WeightsError: the settings name a file that cannot be read.
        """
        asked = model_hash(settings)
        if asked != self.model:
            raise MapError(
                f"the map {folder} was made with the descriptor model {self.model[:12]} (nearfar "
                f"{self.nearfar}), not with {asked[:12]}: name its file with --weights "
                f"nearfar=FILE, or build the map anew"
            )


def manifest_for(settings: Settings, max_size: int) -> Manifest:
    """Return the manifest of a new map.

    Raises:
        WeightsError: the settings name a file that cannot be read.
    """
    version = importlib.metadata.version("nearfar")
    return Manifest(FORMAT, version, DESCRIPTOR, model_hash(settings), max_size, settings.bands)


def model_hash(settings: Settings) -> str:
    """Return the SHA-256 of the descriptor's network that the settings name."""
    return hashlib.sha256(landmark_network(settings)).hexdigest()


def read_manifest(folder: Location) -> Manifest:
    """Return the manifest of a map of the present format.

    Raises:
        MapError: there is no map, or it has another format.
        StorageError: object storage does not answer.
    """
    found = read_any_manifest(folder)
    if OLDEST <= found.format < FORMAT:
        raise MapError(
            f"the map {folder} has the format {found.format} (nearfar {found.nearfar}), this "
            f"version {FORMAT}: run `nearfar map upgrade {folder}`"
        )
    if found.format != FORMAT:
        raise MapError(
            f"the map {folder} has the format {found.format} (nearfar {found.nearfar}), this "
            f"version reads and writes {FORMAT}: use the nearfar that made it, or build it anew"
        )
    return found


def read_any_manifest(folder: Location) -> Manifest:
    """Return the manifest of a map of any format.

    Raises:
        MapError: there is no map, or its manifest is damaged.
        OSError: the manifest cannot be read.
        StorageError: object storage does not answer.
    """
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        content = {"bands": "", **content}  # Maps of version 0.1.0 have none.
        known = {each.name: content[each.name] for each in dataclasses.fields(Manifest)}
        return Manifest(**{**known, "format": int(content["format"])})
    except (FileNotFoundError, NotADirectoryError):
        raise MapError(f"{folder} is not a map: make one with `nearfar map build`") from None
    except (ValueError, KeyError, TypeError):
        raise MapError(f"{folder / FILE} is damaged: build the map anew") from None
