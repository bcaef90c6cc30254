"""Annotations in the layouts that `nearfar bench pairs` reads."""

import json
import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from nearfar.app.annotations import LEAST, Annotation, agreement, arrays
from nearfar.app.errors import ConflictError
from nearfar.app.files import write_whole
from nearfar.arrays import Coordinates
from nearfar.geometry.homography import scale_change
from nearfar.imaging.decoding import FORMATS, quiet_pillow

_SUFFIX = {"JPEG": ".jpg", "PNG": ".png", "TIFF": ".tif", "WEBP": ".webp", "BMP": ".bmp"}


@dataclass(frozen=True)
class ImageFiles:
    """The files of an annotation's images."""

    far: Path
    near: Path


def pair_json(annotation: Annotation, far: str, near: str) -> str:
    """Return the content of `pair.json`.

    Args:
        annotation: an annotation with enough points for its model.
        far: path of the far image relative to the folder of the file.
        near: path of the near image relative to the folder of the file.

    Raises:
        ConflictError: there are too few points.
    """
    far_points, near_points = checked_points(annotation)
    content: dict[str, Any] = {
        "name": annotation.name,
        "far": far,
        "near": near,
        "far_points": _rounded(far_points),
        "near_points": _rounded(near_points),
        "model": annotation.model,
        "scale_change": scale_change(far_points, near_points),
        "ground_truth": "hand",
    }
    if annotation.model == "homography":
        said = agreement(annotation.points)
        content["homography"] = said.homography
        content["ste"] = said.ste
    return json.dumps(content, indent=1) + "\n"


def write_pair_zip(annotation: Annotation, images: ImageFiles, out: Path) -> None:
    """Write `NAME/pair.json` and both images, as they are, into a ZIP file."""
    far, near = f"far{_suffix(images.far)}", f"near{_suffix(images.near)}"
    description = pair_json(annotation, far, near)
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(f"{annotation.name}/pair.json", description)
        archive.write(images.far, f"{annotation.name}/{far}")
        archive.write(images.near, f"{annotation.name}/{near}")


def write_paper_zip(annotation: Annotation, pictures: Sequence[bytes], out: Path) -> None:
    """Write the authors' layout into a ZIP file: `NAME/1.png`, `2.png` and `1_to_2.yaml`.

    Points are shares of width and height, counted from the outer edge of the image.

    Args:
        annotation: an annotation with enough points.
        pictures: the far and the near image as PNG.
        out: the file.
    """
    points = checked_points(annotation)
    shares = {
        name: _rounded((xy + 0.5) / np.array(size), 8)
        for name, xy, size in zip(
            ("1", "2"), points, (annotation.far_size, annotation.near_size), strict=True
        )
    }
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(f"{annotation.name}/1_to_2.yaml", yaml.safe_dump(shares))
        for name, picture in zip(("1", "2"), pictures, strict=True):
            archive.writestr(f"{annotation.name}/{name}.png", picture)


def add_to_benchmark(
    annotation: Annotation, images: ImageFiles, folder: Path, *, replace: bool
) -> Path:
    """Write `NAME/pair.json` into a benchmark folder.

    Images that lie in the folder are named where they are; others are copied beside the file.

    Args:
        annotation: an annotation with enough points.
        images: its images.
        folder: folder of the benchmark.
        replace: whether a pair of that name may be replaced.

    Returns:
        The file written.

    Raises:
        ConflictError: there are too few points, or there is a pair of that name.
        OSError: the folder cannot be written to.
    """
    checked_points(annotation)
    pair = folder / annotation.name
    if pair.is_symlink():
        raise ConflictError(f"{annotation.name} is a link: choose another name")
    if (pair / "pair.json").exists() and not replace:
        raise ConflictError(f"{folder.name} has a pair {annotation.name} already")
    names: dict[str, str] = {}
    copies: dict[Path, Path] = {}
    for role, file in (("far", images.far), ("near", images.near)):
        if file.is_relative_to(folder):
            names[role] = Path(os.path.relpath(file, pair)).as_posix()
        else:
            names[role] = f"{role}{_suffix(file)}"
            copies[pair / names[role]] = file
    for target in copies:
        if os.path.lexists(target) and not replace:
            raise ConflictError(f"{annotation.name} has a {target.name} already")
    pair.mkdir(exist_ok=True)
    for target, file in copies.items():
        write_whole(target, file.read_bytes())
    out = pair / "pair.json"
    write_whole(out, pair_json(annotation, names["far"], names["near"]).encode())
    for written in (*copies, out):
        written.chmod(0o644)
    return out


def checked_points(annotation: Annotation) -> tuple[Coordinates, Coordinates]:
    """Return the (N, 2) far and near points that are marked in both images.

    Raises:
        ConflictError: there are too few for the model.
    """
    far, near = arrays(annotation.points)
    least = LEAST if annotation.model == "homography" else 1
    if len(far) < least:
        raise ConflictError(
            f"mark at least {least} points in both images first; there are {len(far)}"
        )
    return far, near


def _suffix(file: Path) -> str:
    """Return the file suffix for the format in which an image is stored."""
    from PIL import Image as PillowImage

    with quiet_pillow(), PillowImage.open(file, formats=FORMATS) as opened:
        return _SUFFIX.get(opened.format or "", ".ppm")


def _rounded(xy: Coordinates, digits: int = 4) -> list[list[float]]:
    rounded: list[list[float]] = np.round(xy, digits).tolist()
    return rounded
