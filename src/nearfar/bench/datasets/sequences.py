"""Sequences of images with homographies from the first one: Oxford (H1to2p), HPatches (H_1_2)."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.bench.datasets.composites import Case, name_below
from nearfar.errors import BenchmarkError, ImageError
from nearfar.geometry.homography import scale_change, transform
from nearfar.imaging.image import Image, read_image

_HOMOGRAPHY = re.compile(r"H1to(?P<oxford>\d+)p(\.txt)?|H_1_(?P<hpatches>\d+)(\.txt)?")
SUFFIXES = (".ppm", ".pgm", ".png", ".jpg", ".tif")
GRID = 20
"""Columns and rows of near points, of which ten are chosen."""
POINTS = 10


def find_sequence_pairs(folder: Path) -> Iterator[Case]:
    """Pairs (1, K) of every sequence, the image that shows the scene larger being the near one.

    The true points are ten of a grid over the part of the near image that lies in the far one,
    each as far as can be from the others, as the paper spreads its points.

    Raises:
        BenchmarkError: a homography or an image cannot be read, or the images do not overlap.
    """
    for file in sorted(folder.rglob("H*1*")):
        match = _HOMOGRAPHY.fullmatch(file.name)
        if match and file.is_file():
            yield _read(file, int(match["oxford"] or match["hpatches"]), folder)


def _read(file: Path, number: int, folder: Path) -> Case:
    try:
        second_from_first = np.loadtxt(file).reshape(3, 3)
        inverse = np.linalg.inv(second_from_first)
    except (OSError, ValueError, np.linalg.LinAlgError) as error:
        raise BenchmarkError(f"homography {file} cannot be read: {error}") from error
    first, second = (_image(file.parent, index) for index in (1, number))
    orders = []  # Each order has true points of its own, so that the changes are not reciprocal.
    for far, near, far_from_near in ((first, second, inverse), (second, first, second_from_first)):
        far_points, near_points = _grid_points(far, near, far_from_near)
        change = scale_change(far_points, near_points)
        if change is not None:
            orders.append((change, far, near, far_points, near_points))
    if not orders:
        raise BenchmarkError(f"the images related by {file} do not overlap")
    change, far, near, far_points, near_points = max(orders, key=lambda order: order[0])
    sequence = name_below(file.parent, folder)
    return Case(
        name=f"{sequence}/1_{number}",
        group=sequence,
        far=far.path or file,
        near=near.path or file,
        model="homography",
        scale_change=max(change, 1.0),  # Below 1 in both orders: neither shows it larger.
        far_points=far_points,
        near_points=near_points,
    )


def _image(folder: Path, number: int) -> Image:
    for stem in (f"img{number}", str(number)):
        for suffix in SUFFIXES:
            path = folder / f"{stem}{suffix}"
            if path.exists():
                try:
                    return read_image(path)
                except ImageError as error:
                    raise BenchmarkError(str(error)) from error
    raise BenchmarkError(f"{folder} has a homography but no image {number}")


def _grid_points(
    far: Image, near: Image, far_from_near: Matrix3
) -> tuple[Coordinates, Coordinates]:
    """At most ten true points spread over the part of the near image that the far one shows."""
    axes = [(np.arange(GRID) + 0.5) / GRID * side - 0.5 for side in (near.width, near.height)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    mapped = transform(far_from_near, grid)
    inside = (mapped > -0.5).all(axis=1) & (mapped < (far.width - 0.5, far.height - 0.5)).all(
        axis=1
    )
    near_points, far_points = grid[inside], mapped[inside]
    chosen = _spread(near_points)
    return far_points[chosen], near_points[chosen]


def _spread(xy: Coordinates) -> NDArray[np.intp]:
    """Indices of at most ten of (N, 2) points, each as far as can be from those before it."""
    if len(xy) <= POINTS:
        return np.arange(len(xy))
    chosen = [0]
    distance = np.linalg.norm(xy - xy[0], axis=1)
    while len(chosen) < POINTS:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(xy - xy[chosen[-1]], axis=1))
    return np.array(chosen)
