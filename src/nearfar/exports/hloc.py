"""Features and matches of a pair for hloc."""

from pathlib import Path

from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.exports.hloc_files import NamedLocalization, write_hloc
from nearfar.extras import require
from nearfar.settings import Settings


@EXPORTERS.register("hloc")
class HlocExporter(Exporter):
    """A folder with `features.h5`, `matches.h5` and `pairs.txt`, near image first."""

    file_name = "hloc"

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("export", "h5py")

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`.

        Raises:
            ExportError: a name holds white space, at which hloc splits the lines of its lists.
        """
        names = subject.names
        for name in (names.far, names.near):
            if name.split() != [name]:
                raise ExportError(
                    f"hloc's lists cannot hold {name!r}, a name with white space: rename the file, "
                    "or give far= and near= to nearfar.export"
                )
        path.mkdir(exist_ok=True)
        features, matches, pairs = (
            path / name for name in ("features.h5", "matches.h5", "pairs.txt")
        )
        write_hloc([NamedLocalization(names, subject.localization)], features, matches)
        pairs.write_text(f"{names.near} {names.far}\n", encoding="utf-8")
        return [features, matches, pairs]
