"""Pairs of photographs that show one place, found by nearfar itself."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nearfar.errors import TrainingError
from nearfar.localizer import Localizer
from nearfar.storage.locations import replaced
from nearfar.train.photographs import Photograph
from nearfar.train.training_set import RealPair, TrainingSet

PAIRS = "pairs.npz"
"""Name of the file with the pairs of a training."""
ARRAYS = ("neighbours", "names", "ends", "counts", "far", "near")
"""Names of what is in that file."""
LEAST_POINTS = 30
"""Inliers of a pair that is used."""
LEAST_CONFIDENCE = 0.9
"""Of a pair that is used. A wrong pair would teach to confuse places."""


def mined_pairs(
    photographs: list[Photograph],
    neighbours: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[RealPair, ...]:
    """Match each photograph with those that follow it in its folder, by points.

    Photographs of a flight or a walk are in the order of their names, and so are a photograph and
    enlargements of parts of it.

    Args:
        photographs: sorted by path.
        neighbours: how many of the following photographs to try.
        progress: called with how many are done, and of how many.
    """
    localizer = Localizer(max_effort="points", mirror_hints=False, cache_bytes=200_000_000)
    tried = [
        (one, other)
        for one, photograph in enumerate(photographs)
        for other in range(one + 1, min(one + 1 + neighbours, len(photographs)))
        if photographs[other].path.parent == photograph.path.parent
    ]
    found = []
    for number, (one, other) in enumerate(tried, start=1):
        pair = _pair(localizer, photographs, one, other)
        if pair is not None:
            found.append(pair)
        if progress is not None:
            progress(number, len(tried))
    return tuple(found)


def _pair(
    localizer: Localizer, photographs: list[Photograph], one: int, other: int
) -> RealPair | None:
    pixels = (photographs[index].levels[0] for index in (one, other))
    found = localizer.localize(*pixels, model="homography")
    points, inliers = found.points, found.points.inliers
    if found.status == "failed" or inliers.sum() < LEAST_POINTS:
        return None
    if found.confidence is None or found.confidence < LEAST_CONFIDENCE:
        return None
    return RealPair(one, other, points.far[inliers], points.near[inliers])


def save_pairs(file: Path, training_set: TrainingSet, neighbours: int) -> None:
    """Write the pairs of a set, so that they need not be matched again.

    Args:
        file: to write, NPZ.
        training_set: the photographs and their pairs.
        neighbours: see `mined_pairs`.
    """
    pairs = training_set.pairs
    with replaced(file) as incomplete, incomplete.open("wb") as stream:
        np.savez_compressed(
            stream,
            neighbours=neighbours,
            names=np.array([photograph.name for photograph in training_set.photographs]),
            ends=np.array([(pair.far, pair.near) for pair in pairs], np.int64).reshape(-1, 2),
            counts=np.array([len(pair.far_points) for pair in pairs], np.int64),
            far=np.concatenate([np.empty((0, 2)), *(pair.far_points for pair in pairs)]),
            near=np.concatenate([np.empty((0, 2)), *(pair.near_points for pair in pairs)]),
        )


def read_pairs(file: Path, photographs: list[Photograph], neighbours: int) -> tuple[RealPair, ...]:
    """Read the pairs of a set of photographs.

    Raises:
        TrainingError: the file is damaged, or holds pairs of other photographs, or of those
            matched with another number of neighbours.
    """
    try:
        with file.open("rb") as stream, np.load(stream) as content:
            arrays = {name: content[name] for name in ARRAYS}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise TrainingError(f"{file} cannot be read: remove it to match again") from error
    if arrays["names"].tolist() != [photograph.name for photograph in photographs]:
        raise TrainingError(f"{file} holds pairs of other photographs: choose another folder")
    if arrays["neighbours"] != neighbours:
        raise TrainingError(
            f"{file} holds pairs of --neighbours {arrays['neighbours']}: choose another folder"
        )
    until = np.cumsum(arrays["counts"])[:-1]
    points = zip(np.split(arrays["far"], until), np.split(arrays["near"], until), strict=True)
    return tuple(
        RealPair(int(far), int(near), *each)
        for (far, near), each in zip(arrays["ends"], points, strict=False)
    )
