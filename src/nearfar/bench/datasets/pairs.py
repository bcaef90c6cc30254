"""Pairs of images with ground-truth points, read from folders in three layouts."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.bench.datasets.cases import Case, name_below
from nearfar.bench.datasets.tagged_yaml import load_numbers
from nearfar.errors import BenchmarkError, ImageError
from nearfar.geometry.homography import scale_change, transform
from nearfar.imaging.image import Image, read_image


def find_pairs(folder: Path) -> list[Case]:
    """Find all pairs in a folder and its subfolders, sorted by name.

    Raises:
        BenchmarkError: there are no pairs, or a description is malformed.
    """
    if not folder.is_dir():
        raise BenchmarkError(f"{folder} is not a folder")
    described = [_read_pair(file, folder) for file in sorted(folder.rglob("pair.json"))]
    cases = [*described, *find_montreal_pairs(folder), *find_sequence_pairs(folder)]
    if not cases:
        raise BenchmarkError(
            f"there are no pairs in {folder} or its subfolders: no pair.json, no A_to_B.yaml, "
            f"no H1to2p or H_1_2"
        )
    return sorted(cases, key=lambda case: case.name)


def _read_pair(file: Path, folder: Path) -> Case:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BenchmarkError(f"{file} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise BenchmarkError(f"{file} must be a JSON object with far, near, model and points")
    points = ["far_points", "near_points"]
    by_homography = "homography" in content and not all(key in content for key in points)
    wanted = ["far", "near", "model"] + ([] if by_homography else points)
    if missing := [key for key in wanted if key not in content]:
        instead = " (or homography)" if "far_points" in missing else ""
        raise BenchmarkError(f"{file} lacks {', '.join(missing)}{instead}")
    if wrong := [key for key in wanted[:3] if not isinstance(content[key], str)]:
        raise BenchmarkError(f"{file}: {wrong[0]} must be a text, not {content[wrong[0]]!r}")
    far, near = file.parent / content["far"], file.parent / content["near"]
    model = content["model"]
    least = {"homography": 4, "fundamental": 1}.get(model)
    if by_homography:
        far_points, near_points = _points_of_homography(file, content["homography"], far, near)
    else:
        far_points, near_points = (_points(file, content, f"{s}_points") for s in ("far", "near"))
    if least is None or len(far_points) != len(near_points) or len(far_points) < least:
        raise BenchmarkError(
            f"{file} needs the model homography or fundamental, and as many far_points as "
            f"near_points: at least 4 for a homography"
        )
    return Case(
        name=name_below(file.parent, folder),
        group=str(content.get("set", file.parent.parent.name or file.resolve().parents[1].name)),
        far=far,
        near=near,
        model=model,
        scale_change=scale_change(far_points, near_points),
        far_points=far_points,
        near_points=near_points,
        tags={"licence": str(content.get("licence", "not stated"))},
    )


def _points(file: Path, content: dict[str, Any], key: str) -> Coordinates:
    try:
        return np.array(content[key], np.float64).reshape(-1, 2)
    except (TypeError, ValueError) as error:
        raise BenchmarkError(f"{file}: {key} must be a list of [x, y], in pixels") from error


def _points_of_homography(
    file: Path, rows: Any, far: Path, near: Path
) -> tuple[Coordinates, Coordinates]:
    """Return true points that the homography of a pair.json gives, as for sequences.

    Args:
        file: the pair.json.
        rows: its `homography`, 3 rows of 3 numbers that map near pixels to far pixels.
        far: path of the far image.
        near: path of the near image.
    """
    try:
        matrix = np.array(rows, np.float64).reshape(3, 3)
        np.linalg.inv(matrix)
        images = read_image(far), read_image(near)
    except (TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise BenchmarkError(
            f"{file}: homography must be an invertible matrix, 3 rows of 3 numbers that map near "
            f"pixels to far pixels"
        ) from error
    except ImageError as error:
        raise BenchmarkError(f"{file}: {error}") from error
    found = _grid_points(*images, matrix)
    if len(found[0]) < 4:
        raise BenchmarkError(f"{file}: by its homography the far image does not show the near one")
    return found


MONTREAL = "montreal"
"""Tag of the cases that are read from the layout of the authors' Montreal pictures."""
_DESCRIPTION = re.compile(r"(?P<first>.+)_to_(?P<second>.+)\.ya?ml")


def find_montreal_pairs(folder: Path) -> Iterator[Case]:
    """Find the pairs of the Montreal layout: A_to_B.yaml, with A.png and B.png beside it.

    A file maps the name of each image to its points, [x, y] as shares of width and height. The
    image whose points are farther apart is the near one.

    Raises:
        BenchmarkError: a file is malformed, or an image cannot be read.
    """
    for file in sorted(folder.rglob("*_to_*.y*ml")):
        match = _DESCRIPTION.fullmatch(file.name)
        if match:
            yield _read(file, match["first"], match["second"], folder)


def _read(file: Path, first: str, second: str, folder: Path) -> Case:
    content = _load(file)
    views = [_view(file, content, name) for name in (first, second)]
    if len(views[0][1]) != len(views[1][1]) or len(views[0][1]) < 4:
        raise BenchmarkError(f"{file} needs as many points in {first} as in {second}, at least 4")
    change = scale_change(views[0][1], views[1][1])
    if not change:
        raise BenchmarkError(f"{file} needs at least two different points")
    if change < 1:
        views.reverse()
    (far, far_points), (near, near_points) = views
    scene = name_below(file.parent, folder)
    return Case(
        name=f"{scene}/{file.stem}",
        group=scene,
        far=far,
        near=near,
        model="homography",
        scale_change=max(change, 1 / change),
        far_points=far_points,
        near_points=near_points,
        tags={"layout": MONTREAL},
    )


def _load(file: Path) -> dict[str, object]:
    try:
        content = load_numbers(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BenchmarkError(f"{file} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise BenchmarkError(f"{file} must map the names of both images to their points")
    return {Path(str(name)).stem: value for name, value in content.items()}


def _view(file: Path, content: dict[str, object], name: str) -> tuple[Path, Coordinates]:
    """Return the path of one image, and its points in pixels."""
    path = file.parent / f"{name}.png"
    try:
        image = read_image(path)
        shares = np.array(content[name], np.float64).reshape(-1, 2)
    except (ImageError, KeyError, TypeError, ValueError) as error:
        raise BenchmarkError(f"{file} is not valid for image {name}: {error!r}") from error
    # A share counts from the left edge of the image, half a pixel before the first centre.
    return path, shares * (image.width, image.height) - 0.5


_HOMOGRAPHY = re.compile(r"H1to(?P<oxford>\d+)p(\.txt)?|H_1_(?P<hpatches>\d+)(\.txt)?")
SUFFIXES = (".ppm", ".pgm", ".png", ".jpg", ".tif")
GRID = 20
"""Columns and rows of the grid of near points from which the true points are chosen."""
POINTS = 10


def find_sequence_pairs(folder: Path) -> Iterator[Case]:
    """Find pairs (1, K) of sequences with homographies: Oxford (H1to2p) and HPatches (H_1_2).

    The image that shows the scene larger is the near one. The true points are ten points of a grid
    over the part of the near image that the far image shows, spread far apart as in the paper.

    Raises:
        BenchmarkError: a homography or an image cannot be read, or the images do not overlap.
    """
    for file in sorted(folder.rglob("H*1*")):
        match = _HOMOGRAPHY.fullmatch(file.name)
        if match and file.is_file():
            yield _read_sequence(file, int(match["oxford"] or match["hpatches"]), folder)


def _read_sequence(file: Path, number: int, folder: Path) -> Case:
    try:
        second_from_first = np.loadtxt(file).reshape(3, 3)
        inverse = np.linalg.inv(second_from_first)
    except (OSError, ValueError, np.linalg.LinAlgError) as error:
        raise BenchmarkError(f"homography {file} cannot be read: {error}") from error
    first, second = (_image(file.parent, index) for index in (1, number))
    orders = []  # Each order has its own true points, so the scale changes are not reciprocal.
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
    """Choose at most ten true points over the part of the near image that the far image shows."""
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
    """Return indices of at most ten of (N, 2) points, each the farthest from those before."""
    if len(xy) <= POINTS:
        return np.arange(len(xy))
    chosen = [0]
    distance = np.linalg.norm(xy - xy[0], axis=1)
    while len(chosen) < POINTS:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(xy - xy[chosen[-1]], axis=1))
    return np.array(chosen)
