"""The HDF5 files of hloc (github.com/cvg/Hierarchical-Localization). Needs the extra `export`.

As hloc's `match_dense` leaves them: of features `<image>/keypoints` and `<image>/image_size`, of
matches `<pair>/matches0` and `<pair>/matching_scores0`. Pixel centres are at integers there too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.exports.indexed import IndexedMatches, Keypoints, distinct, indexed_in
from nearfar.exports.subject import ImageNames
from nearfar.localization import Localization
from nearfar.storage import replaced


@dataclass(frozen=True, eq=False)
class NamedLocalization:
    """A localization, and what its images are called."""

    names: ImageNames
    localization: Localization


@dataclass(frozen=True, eq=False)
class _Features:
    keypoints: Keypoints
    size: tuple[int, int]


def names_to_pair(name0: str, name1: str) -> str:
    """The key of a pair, as in hloc's `utils/parsers.py`."""
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
    return {name: _Features(distinct(np.vstack(xy)), sizes[name]) for name, xy in points.items()}


def _write_pair(group: Any, matches: IndexedMatches) -> None:
    near, far = matches.pairs.T
    matches0 = np.full(len(matches.near), -1, np.int32)
    scores = np.zeros(len(matches.near), np.float16)
    matches0[near] = far
    scores[near] = matches.inliers
    group.create_dataset("matches0", data=matches0)
    group.create_dataset("matching_scores0", data=scores)
