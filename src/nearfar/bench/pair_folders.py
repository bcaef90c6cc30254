"""Image pairs with corresponding points, in three layouts."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.arrays import Coordinates
from nearfar.bench.cases import Case, name_below
from nearfar.bench.montreal import find_montreal_pairs
from nearfar.bench.sequences import find_sequence_pairs
from nearfar.errors import BenchmarkError
from nearfar.geometry.scale import scale_change


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
