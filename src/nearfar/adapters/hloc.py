"""nearfar instead of hloc's `match_dense`. It needs the extra `export`, but not hloc."""

import logging
from pathlib import Path
from typing import Any

from nearfar.errors import ExportError
from nearfar.exports.hloc import NamedLocalization, write_hloc
from nearfar.exports.subject import Subject
from nearfar.localizer import Localizer
from nearfar.models import ModelKind
from nearfar.runtime import logs, require
from nearfar.runtime.failures import reason_of_error
from nearfar.storage.locations import replaced


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

    A pair whose images cannot be read, or that EXIF data rotate, is left out, and the others go on.
    Then `MATCHES-failed.txt` has a line for each such pair, with the reason. `MATCHES-pairs.txt`
    lists the other pairs, for hloc's later steps.

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
        ExportError: a line of the list is not a pair, or no pair of the list can be matched.
        NearfarError: the settings or the weights are not valid.
        OSError: a file cannot be read or written.
    """
    require("export", "h5py")
    localizer = Localizer(**options)
    found: list[NamedLocalization] = []
    failed: dict[tuple[str, str], str] = {}
    for near, far in _read_pairs(pairs):
        try:
            localization = localizer.localize(image_dir / far, image_dir / near, model=model)
            names = Subject(localization, far=far, near=near).names
        except Exception as error:  # Libraries raise many kinds of errors for an image.
            reason = failed[near, far] = reason_of_error(error)
            logs.event(f"left out {near} {far}: {reason}", logging.WARNING)
            continue
        found.append(NamedLocalization(names, localization))
    if failed and not found:
        raise ExportError(f"no pair of {pairs} can be matched: {next(iter(failed.values()))}")
    _record(matches, found, failed)
    write_hloc(found, features, matches)
    return features, matches


def _record(
    matches: Path, found: list[NamedLocalization], failed: dict[tuple[str, str], str]
) -> None:
    """Write the pairs that were left out, and those that were not; remove lists of earlier runs."""
    lists = {
        "failed": [f"{near} {far} {reason}" for (near, far), reason in failed.items()],
        "pairs": [f"{each.names.near} {each.names.far}" for each in found] if failed else [],
    }
    for name, lines in lists.items():
        file = matches.with_name(f"{matches.stem}-{name}.txt")
        if not lines:
            file.unlink(missing_ok=True)
            continue
        with replaced(file) as out:
            out.write_text("\n".join(lines) + "\n", encoding="utf-8")


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
