"""The format of hloc: HDF5 files of features and matches. Needs the extra `export`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.exports.subject import (
    ImageNames,
    IndexedMatches,
    KeypointArray,
    distinct_points,
    indexed_in,
)
from nearfar.localization import Localization
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import replaced


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
                    f"hloc's lists cannot hold {name!r}, a name with white space: rename the file "
                    "(in Python: give far= and near= to nearfar.export)"
                )
        path.mkdir(exist_ok=True)
        features, matches, pairs = (
            path / name for name in ("features.h5", "matches.h5", "pairs.txt")
        )
        write_hloc([NamedLocalization(names, subject.localization)], features, matches)
        pairs.write_text(f"{names.near} {names.far}\n", encoding="utf-8")
        return [features, matches, pairs]


@dataclass(frozen=True, eq=False)
class NamedLocalization:
    """A localization and the names of its images."""

    names: ImageNames
    localization: Localization


@dataclass(frozen=True, eq=False)
class _Features:
    keypoints: KeypointArray
    size: tuple[int, int]


def names_to_pair(name0: str, name1: str) -> str:
    """Return the key of a pair, as in hloc's `utils/parsers.py`."""
    return f"{name0.replace('/', '-')}/{name1.replace('/', '-')}"


def write_hloc(pairs: Sequence[NamedLocalization], features: Path, matches: Path) -> None:
    """Write features of all images and matches of all pairs; the near image comes first.

    A match that agrees with the model has the score 1, another one 0. Points at the very same
    place in an image are one keypoint, also when they are of several pairs.

    Raises:
        OSError: a file cannot be written.
    """
    import h5py

    images = _features(pairs)
    with replaced(features) as out, h5py.File(out, "w") as file:
        for name, image in images.items():
            group = file.create_group(name)
            group.create_dataset("keypoints", data=image.keypoints)
            group.create_dataset("image_size", data=np.array(image.size))
            group["keypoints"].attrs["uncertainty"] = 1.0
    with replaced(matches) as out, h5py.File(out, "w") as file:
        for each in pairs:
            names, points = each.names, each.localization.points
            near, far = images[names.near].keypoints, images[names.far].keypoints
            _write_pair(
                file.create_group(names_to_pair(names.near, names.far)),
                indexed_in(points, near, far),
            )


def _features(pairs: Sequence[NamedLocalization]) -> dict[str, _Features]:
    points: dict[str, list[NDArray[np.floating]]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for each in pairs:
        found = each.localization
        for name, image, xy in (
            (each.names.near, found.near, found.points.near),
            (each.names.far, found.far, found.points.far),
        ):
            points.setdefault(name, []).append(xy)
            sizes[name] = image.width, image.height
    return {
        name: _Features(distinct_points(np.vstack(xy)), sizes[name]) for name, xy in points.items()
    }


def _write_pair(group: Any, matches: IndexedMatches) -> None:
    near, far = matches.pairs.T
    matches0 = np.full(len(matches.near), -1, np.int32)
    scores = np.zeros(len(matches.near), np.float16)
    matches0[near] = far
    scores[near] = matches.inliers
    group.create_dataset("matches0", data=matches0)
    group.create_dataset("matching_scores0", data=scores)
