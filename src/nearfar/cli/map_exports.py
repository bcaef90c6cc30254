"""Files for other tools, written from the answers of `nearfar map locate`."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from nearfar.errors import NearfarError, SettingsError
from nearfar.exports import CollectionExporter, Exporter, Subject, exporter
from nearfar.exports.ground import ground_of
from nearfar.storage.locations import Location


@dataclass(frozen=True)
class Written:
    """What exports have written.

    Attributes:
        files: the files written.
        failed: what could not be written, and why.
    """

    files: list[Path] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class MapExports:
    """The formats to write, and where.

    Attributes:
        exporters: one for each format.
        folder: for the files.
        dem: raster of heights in metres; None without one.
    """

    exporters: tuple[Exporter, ...]
    folder: Path
    dem: Path | None

    def write(self, subjects: Sequence[tuple[str, Subject]]) -> Written:
        """Write the files: of some formats one for all queries, of others one for each query.

        Args:
            subjects: name of the files of each query that was located, and its best answer.
        """
        given = [(name, replace(each, dem=self.dem)) for name, each in subjects]
        written = Written()
        for each in self.exporters:
            if isinstance(each, CollectionExporter):
                self._collected(each, given, written)
                continue
            for name, subject in given:
                path = self.folder / f"{name}-{each.file_name}"
                try:
                    written.files.extend(each.write(subject, path))
                except (NearfarError, OSError) as error:
                    written.failed.append(f"{name}: not exported as {each.name}: {error}")
        return written

    def _collected(
        self,
        format_: CollectionExporter,
        subjects: Sequence[tuple[str, Subject]],
        written: Written,
    ) -> None:
        placed = []
        for name, subject in subjects:
            try:
                ground_of(subject)
            except NearfarError as error:
                written.failed.append(f"{name}: not exported as {format_.name}: {error}")
            else:
                placed.append(subject)
        if placed:
            try:
                written.files.extend(format_.write_all(placed, self.folder / format_.file_name))
            except (NearfarError, OSError) as error:
                written.failed.append(f"not exported as {format_.name}: {error}")


def map_exports(
    formats: Sequence[str], save: Location | None, dem: Path | None
) -> MapExports | None:
    """Return the exports that the options name; None where they name none.

    Raises:
        SettingsError: there is no such format, or no local folder for it.
        MissingExtraError: a package that a format needs is not installed.
    """
    if not formats:
        return None
    if not isinstance(save, Path):
        raise SettingsError("--export needs a local folder to write to: --save DIR")
    return MapExports(tuple(exporter(name) for name in dict.fromkeys(formats)), save, dem)
