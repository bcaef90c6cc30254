"""Pairs of images with ground-truth points, in folders."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.arrays import Coordinates
from nearfar.bench.datasets.composites import Case, name_below
from nearfar.bench.datasets.sequences import find_sequence_pairs
from nearfar.errors import BenchmarkError, ImageError
from nearfar.geometry.homography import scale_change
from nearfar.imaging.image import read_image
from nearfar.runtime.extras import require


def find_pairs(folder: Path) -> list[Case]:
    """All pairs in a folder and its subfolders, sorted by name.

    Raises:
        BenchmarkError: there are none, or a description is malformed.
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
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        far_points, near_points = _points(content["far_points"]), _points(content["near_points"])
        far, near = file.parent / content["far"], file.parent / content["near"]
        model = content["model"]
        least = {"homography": 4, "fundamental": 1}.get(model)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BenchmarkError(f"{file} is not a valid pair: {error!r}") from error
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


def _points(values: Any) -> Coordinates:
    return np.array(values, np.float64).reshape(-1, 2)


_DESCRIPTION = re.compile(r"(?P<first>.+)_to_(?P<second>.+)\.ya?ml")


def find_montreal_pairs(folder: Path) -> Iterator[Case]:
    """The pairs of all A_to_B.yaml, each with the images A.png and B.png beside it.

    A file maps each image's name to the corresponding points, [x, y] as shares of its width and
    height. The image with the points farther apart is the near one.

    Raises:
        BenchmarkError: a file is malformed, or an image cannot be read.
        MissingExtraError: PyYAML is not installed.
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
    )


def _load(file: Path) -> dict[str, object]:
    require("bench", "yaml")
    import yaml

    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BenchmarkError(f"{file} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise BenchmarkError(f"{file} must map the names of both images to their points")
    return {Path(str(name)).stem: value for name, value in content.items()}


def _view(file: Path, content: dict[str, object], name: str) -> tuple[Path, Coordinates]:
    """Path and points, in pixels, of one image."""
    path = file.parent / f"{name}.png"
    try:
        image = read_image(path)
        shares = np.array(content[name], np.float64).reshape(-1, 2)
    except (ImageError, KeyError, TypeError, ValueError) as error:
        raise BenchmarkError(f"{file} is not valid for image {name}: {error!r}") from error
    # A share counts from the left edge of the image, half a pixel before the first centre.
    return path, shares * (image.width, image.height) - 0.5
