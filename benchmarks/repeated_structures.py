"""Count sure but wrong places on repeated structures, and close-ups with context that are found.

    python benchmarks/repeated_structures.py PHOTOS --out repeated.jsonl [--structures 30]

A far image is a photograph of PHOTOS with 2 to 12 copies of a part of another photograph, in a row,
in a lattice or scattered, each with its own noise and shade. One close-up shows a copy alone: its
place is one of several equal ones. Another shows an outer copy and the photograph around it: that
place is unique. The table counts close-ups of a copy with a confidence of 0.5 or more in a
wrong place, and close-ups with context that are found within 3 pixels. Rows are appended;
structures that are there are skipped.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nearfar import Localization, Localizer
from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import outline, scaling, transform, translation
from nearfar.imaging.image import read_image

SIZE = (960, 720)
"""Width and height of every far image, in pixels."""
LARGER = 3.0
"""How much larger a close-up shows the scene."""
KINDS = ("row", "lattice", "scattered")


def picture(file: Path) -> RGBPixels:
    """Return a photograph at the size of all far images."""
    return np.asarray(cv2.resize(read_image(file).pixels, SIZE, interpolation=cv2.INTER_AREA))


def places(kind: str, side: tuple[int, int], rng: np.random.Generator) -> Coordinates:
    """Return the (N, 2) top left corners of the copies, N from 2 to 12, none over another."""
    count, period = int(rng.integers(2, 13)), rng.uniform(1.0, 1.5, 2)
    step = np.ceil(np.array(side) * period)
    if kind == "scattered":
        found: list[Coordinates] = []
        while len(found) < count:
            at = rng.uniform(10, np.array(SIZE) - side - 10)
            apart = [(np.abs(at - other) > side).any() for other in found]
            if all(apart):
                found.append(at)
        return np.asarray(np.rint(np.array(found)))
    columns = count if kind == "row" else max(2, round(count / 3))
    columns = min(columns, int((SIZE[0] - 40) // step[0]))
    rows = 1 if kind == "row" else min(3, int((SIZE[1] - 40) // step[1]))
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    room = np.array(SIZE) - step * [columns, rows]
    return np.asarray(np.rint(rng.uniform(10, np.maximum(room - 10, 11)) + grid * step))


def repeated(
    background: RGBPixels, part: RGBPixels, corners: Coordinates, rng: np.random.Generator
) -> RGBPixels:
    """Return the photograph with a copy of the part at each corner."""
    far = background.astype(np.float64)
    height, width = part.shape[:2]
    for x, y in corners.astype(int):
        far[y : y + height, x : x + width] = part * rng.uniform(0.95, 1.05)
    return np.clip(far + rng.normal(0, 2, far.shape), 0, 255).astype(np.uint8)


def close_up(
    far: RGBPixels, box: tuple[int, int, int, int], rng: np.random.Generator
) -> tuple[RGBPixels, Matrix3]:
    """Return a box of the far image enlarged, and the homography to the far image."""
    x, y, width, height = box
    near = cv2.resize(
        far[y : y + height, x : x + width],
        None,
        fx=LARGER,
        fy=LARGER,
        interpolation=cv2.INTER_CUBIC,
    )
    noisy = np.clip(near + rng.normal(0, 3, near.shape), 0, 255).astype(np.uint8)
    return noisy, translation(x, y) @ scaling(1 / LARGER, 1 / LARGER)


def error(found: Localization, truth: Matrix3) -> float | None:
    """Return the mean error of the corners in far pixels; None where nothing was found."""
    if found.far_from_near is None:
        return None
    corners = outline(found.near.width, found.near.height)
    away = transform(np.asarray(found.far_from_near), corners) - transform(truth, corners)
    return float(np.linalg.norm(away, axis=1).mean())


def measured(photos: list[Path], index: int, localizer: Localizer) -> dict[str, Any]:
    """Localize a copy alone, and an outer copy with its surroundings."""
    rng = np.random.default_rng(index)
    kind = KINDS[index % len(KINDS)]
    first, second = rng.choice(len(photos), 2, replace=False)
    width, height = side = int(rng.integers(90, 150)), int(rng.integers(80, 130))
    left, top = (rng.uniform(0.2, 0.6) * np.array(SIZE)).astype(int)
    part = picture(photos[second])[top : top + height, left : left + width]
    corners = places(kind, side, rng)
    far = repeated(picture(photos[first]), part, corners, rng)
    x, y = corners[rng.integers(len(corners))].astype(int)
    alone, truth = close_up(far, (x, y, width, height), rng)
    found = localizer.localize(far, alone)
    x, y = corners[np.argmin(corners.sum(axis=1))].astype(int)
    x, y = max(0, x - width), max(0, y - height)
    wide = min(2 * width, SIZE[0] - x), min(2 * height, SIZE[1] - y)
    context, true_context = close_up(far, (x, y, *wide), rng)
    other = localizer.localize(far, context)
    return {
        "structure": index,
        "kind": kind,
        "copies": len(corners),
        "alone": {"error": error(found, truth), "confidence": found.confidence},
        "context": {"error": error(other, true_context), "confidence": other.confidence},
    }


def show(rows: Sequence[dict[str, Any]]) -> None:
    """Print the table of rows."""
    print("| structure | structures | wrong and sure | with context, found |\n|---|---|---|---|")
    for name in (*KINDS, "all"):
        own = [row for row in rows if name in (row["kind"], "all")]
        wrong = sum(
            row["alone"]["error"] is not None
            and row["alone"]["error"] >= 3
            and row["alone"]["confidence"] >= 0.5
            for row in own
        )
        kept = sum(
            row["context"]["error"] is not None and row["context"]["error"] < 3 for row in own
        )
        print(f"| {name} | {len(own)} | {wrong} | {kept} |")


def main() -> None:
    """Localize all close-ups and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--structures", type=int, default=30)
    options = parser.parse_args()
    photos = sorted(each for each in options.photos.rglob("*") if each.suffix in (".jpg", ".png"))
    lines = options.out.read_text().splitlines() if options.out.exists() else []
    rows = [json.loads(line) for line in lines]
    localizer = Localizer()
    for index in range(len(rows), options.structures):
        rows.append(measured(photos, index, localizer))
        with options.out.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    show(rows)


if __name__ == "__main__":
    main()
