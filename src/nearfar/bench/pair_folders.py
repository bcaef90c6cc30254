"""Image pairs with corresponding points, each described by a `pair.json`."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.bench.cases import Case
from nearfar.errors import BenchmarkError
from nearfar.geometry.scale import scale_change


def find_pairs(folder: Path) -> list[Case]:
    """All pairs in a folder and its subfolders, sorted by name.

    Raises:
        BenchmarkError: there are none, or a `pair.json` is malformed.
    """
    files = sorted(folder.rglob("pair.json"))
    if not files:
        raise BenchmarkError(f"there is no pair.json in {folder} or its subfolders")
    return [_read_pair(file, folder) for file in files]


def _read_pair(file: Path, folder: Path) -> Case:
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        far_points = np.array(content["far_points"], np.float64).reshape(-1, 2)
        near_points = np.array(content["near_points"], np.float64).reshape(-1, 2)
        far, near, model = content["far"], content["near"], content["model"]
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BenchmarkError(f"{file} is not a valid pair: {error!r}") from error
    if len(far_points) != len(near_points) or model not in ("homography", "fundamental"):
        raise BenchmarkError(
            f"{file} needs as many far_points as near_points, and the model homography or "
            f"fundamental"
        )
    name = file.parent.relative_to(folder).as_posix()
    return Case(
        name=name if name != "." else file.parent.name,
        group=str(content.get("set", file.parent.parent.name)),
        far=file.parent / far,
        near=file.parent / near,
        model=model,
        scale_change=scale_change(far_points, near_points),
        far_points=far_points,
        near_points=near_points,
    )
