"""Export formats, which write a localization into files of other tools (docs/exports.md)."""

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nearfar.errors import NearfarError, SettingsError
from nearfar.exports.subject import Subject
from nearfar.geometry.camera_files import IntrinsicsSource, read_intrinsics
from nearfar.imaging.image import ImagePair, ImageSource
from nearfar.localization import Localization, read_again, read_images
from nearfar.registry import EXTERNAL, Registry
from nearfar.settings import Settings

__all__ = [
    "EXPORTERS",
    "CollectionExporter",
    "Exported",
    "Exporter",
    "Subject",
    "export",
    "export_all",
    "exporter",
]


class Exporter(ABC):
    """Writes localizations in one format.

    Args:
        name: name of the format.
        settings: not used; plug-ins of every kind are created with settings.

    Raises:
        MissingExtraError: a package that the format needs is not installed.

    Attributes:
        file_name: name of the file or folder, beside other results of a localization.
        full_resolution: whether it draws the near image in its original size.
    """

    file_name: str
    full_resolution: bool = False

    def __init__(self, name: str, settings: Settings) -> None:  # noqa: ARG002
        self.name = name

    @abstractmethod
    def write(self, subject: Subject, path: Path) -> list[Path]:
        """Write a file or, for a format of several files, a folder; what is there is replaced.

        Returns:
            The files written.

        Raises:
            ExportError: the format has no place for such a localization.
            ImageError: the far image's file does not allow it.
            OSError: a file cannot be written.
        """


class CollectionExporter(Exporter):
    """Writes many localizations into one file."""

    @abstractmethod
    def write_all(self, subjects: Sequence[Subject], path: Path) -> list[Path]:
        """Write localizations into one file; what is there is replaced.

        Args:
            subjects: one localization or more.
            path: file to write.

        Returns:
            The files written.

        Raises:
            ExportError: the format has no place for such a localization.
            ImageError: a far image's file does not allow it.
            OSError: a file cannot be written.
        """

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        return self.write_all([subject], path)


EXPORTERS: Registry[Exporter] = Registry("export format", "nearfar.exports")


def registered_exporter(name: str) -> Exporter:
    """Return the exporter of a registered format.

    Unlike `exporter` it imports nothing that the name tells, so the name may come from a stranger.

    Raises:
        SettingsError: there is no such format.
        MissingExtraError: a package that the format needs is not installed.
    """
    names = EXPORTERS.names()
    if name not in names:
        raise SettingsError(f"unknown export format {name!r}; there are {', '.join(names)}")
    return EXPORTERS.create(name, Settings())


def exporter(name: str) -> Exporter:
    """Return the exporter of a format: its registered name, or `python:module.Class`.

    Raises:
        SettingsError: there is no such format.
        MissingExtraError: a package that the format needs is not installed.
    """
    if name.startswith(EXTERNAL):
        return EXPORTERS.create(name, Settings())
    return registered_exporter(name)


@dataclass(frozen=True)
class Exported:
    """What several exporters have written.

    Attributes:
        files: the files written.
        failed: why a format was not written, by the name of the format.
    """

    files: tuple[Path, ...]
    failed: dict[str, str]


def export_all(subject: Subject, exporters: Sequence[Exporter], folder: Path) -> Exported:
    """Write a localization in several formats; a format that fails does not stop the others.

    Args:
        subject: the localization.
        exporters: the formats.
        folder: folder to write into, which must exist.
    """
    files: list[Path] = []
    failed: dict[str, str] = {}
    for each in exporters:
        try:
            files += each.write(subject, folder / each.file_name)
        except NearfarError as error:
            failed[each.name] = str(error)
        except OSError as error:
            failed[each.name] = f"{error.filename or each.file_name}: {error.strerror or error}"
    return Exported(tuple(files), failed)


def export(
    localization: Localization,
    format: str,  # noqa: A002
    path: str | os.PathLike[str],
    *,
    far: str | None = None,
    near: str | None = None,
    intrinsics: IntrinsicsSource | None = None,
    images: Sequence[ImageSource] | None = None,
    dem: str | os.PathLike[str] | None = None,
) -> list[Path]:
    """Write a localization in the format of another tool.

    Args:
        localization: the localization to write.
        format: "colmap", "csv", "gdal-gcps", "geojson", "geopackage", "geotiff", "hloc", "kitti",
            "kml", "kmz", "odm", "opencv-yaml", "png", "qgis-points", "svg", "tum" or "world-file".
        path: file to write, for "hloc", "kml" and "world-file" a folder; what is there is replaced.
        far: what the far image is called in formats that name images ("colmap", "geojson",
            "hloc"); by default its path, for "colmap" and "hloc" relative to the deepest folder
            that holds both images.
        near: what the near image is called in formats that name images.
        intrinsics: of both cameras, as they were given to `localize`; "colmap" needs them for a
            pose, "opencv-yaml" notes them.
        images: the far and the near image as they were given to `localize`, for formats that draw
            them ("png", "svg", and "geotiff", "kml", "kmz", "world-file", which warp the near
            image in its original size); they are read from their files where None.
        dem: raster of heights in metres, for "odm".

    Returns:
        The files written.

    Raises:
        ExportError: the format has no place for such a localization, e.g. poses without a pose.
        ImageError: an image does not allow it, e.g. a GeoTIFF that is stored turned, or is needed
            again and was an array.
        SettingsError: there is no such format.
        MissingExtraError: a package that the format needs is not installed.
        IntrinsicsError: the intrinsics are not valid.
        OSError: a file cannot be written.
    """
    known = None if intrinsics is None else read_intrinsics(intrinsics)
    target = Path(path)
    writer = exporter(format)
    target.parent.mkdir(parents=True, exist_ok=True)
    pair = None if images is None else read_images(localization, images)
    if pair is not None and images is not None and writer.full_resolution:
        pair = ImagePair(pair.far, read_again(localization.near, images[1], full=True))
    heights = None if dem is None else Path(dem)
    return writer.write(Subject(localization, known, far, near, pair, heights), target)
