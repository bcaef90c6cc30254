"""nearfar instead of hloc's `match_dense`. It needs the extra `export`, but not hloc."""

from pathlib import Path
from typing import Any

from nearfar.errors import ExportError
from nearfar.exports.hloc import NamedLocalization, write_hloc
from nearfar.exports.subject import Subject
from nearfar.localizer import Localizer
from nearfar.models import ModelKind
from nearfar.runtime import require


def match_pairs(
    pairs: Path,
    image_dir: Path,
    features: Path,
    matches: Path,
    *,
    model: ModelKind = "fundamental",
    **options: Any,
) -> tuple[Path, Path]:
    """Match pairs of images, and write hloc's files of features and matches.

    Args:
        pairs: hloc's list of pairs, two names a line: the near image (the query), then the far
            image. A pair that is repeated, in either order, is matched once.
        image_dir: folder that the names are relative to.
        features: HDF5 file of keypoints to write.
        matches: HDF5 file of matches to write.
        model: kind of model that scores the matches: 1 for an inlier, 0 for others. Use a
            fundamental matrix for scenes with depth.
        **options: `Settings` by name, e.g. method="sift-tuned".

    Returns:
        `features` and `matches`, as `match_dense.main` does.

    Raises:
        ExportError: a line of the list is not a pair, or the EXIF data of an image rotate it.
        NearfarError: an image, the settings or the weights are not valid.
        OSError: a file cannot be read or written.
    """
    require("export", "h5py")
    localizer = Localizer(**options)
    found = []
    for near, far in _read_pairs(pairs):
        localization = localizer.localize(image_dir / far, image_dir / near, model=model)
        names = Subject(localization, far=far, near=near).names
        found.append(NamedLocalization(names, localization))
    write_hloc(found, features, matches)
    return features, matches


def _read_pairs(file: Path) -> list[tuple[str, str]]:
    pairs: dict[tuple[str, str], None] = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if not words:
            continue
        if len(words) != 2:
            raise ExportError(f"{file} needs two names of images a line, not {line!r}")
        first, second = words
        if (second, first) not in pairs:
            pairs[first, second] = None
    return list(pairs)
