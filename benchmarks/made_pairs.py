"""Localize made pairs with exact truth: parts of photographs in other light, blurred and tilted.

    python benchmarks/made_pairs.py PHOTOS OUT.jsonl [--pairs 200] [--max-effort zoom]

The near image is a part of a photograph of PHOTOS, seen with perspective, at 1.5 to 8 times the
scale of the far image, in changed light and colours. The far image is the whole photograph. The
rows are those that `calibration.py` reads; no threshold refuses an answer. A run that was stopped
goes on where it was.
"""

import argparse
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nearfar import Localizer
from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.bench.runner import expected_columns
from nearfar.geometry.homography import scaling, transform
from nearfar.imaging.image import read_image
from nearfar.settings import Settings
from nearfar.storage.rows import RowFile, read_rows

SIZE = (640, 480)
"""Width and height of every near image, in pixels."""
AMOUNTS = (0.3, 1.0, 1.6)
"""How much light and colours of the near image change; those of the far one by the first."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A made pair.

    Attributes:
        far: the whole photograph, reduced.
        near: a part of it.
        far_from_near: the true homography.
    """

    far: RGBPixels
    near: RGBPixels
    far_from_near: Matrix3


def relit(pixels: RGBPixels, rng: np.random.Generator, amount: float) -> RGBPixels:
    """Return the image with another tone curve, contrast, colours, shade, haze, blur and noise."""
    height, width = pixels.shape[:2]
    values = (pixels / 255.0) ** np.exp(rng.normal(0, 0.5 * amount))
    values = (values - 0.5) * np.exp(rng.normal(0, 0.3 * amount)) + 0.5
    values += rng.normal(0, 0.1 * amount)
    mixed = np.eye(3) + rng.normal(0, 0.25 * amount, (3, 3))
    values = values @ (mixed / mixed.sum(axis=1, keepdims=True)).T
    shade = rng.normal(0, 1, (4, 4)).astype(np.float32)
    shade = cv2.resize(shade, (width, height), interpolation=cv2.INTER_CUBIC)
    values *= np.exp(0.35 * amount * shade)[..., np.newaxis]
    if rng.random() < 0.3 * amount:
        values = 0.4 * values + 0.6 * np.array([0.6, 0.75, 0.8])
    if rng.random() < 0.15 * amount:
        values = 1 - values
    if rng.random() < 0.5:
        values = cv2.GaussianBlur(values, (0, 0), rng.uniform(0.5, 1 + 2 * amount))
    values += rng.normal(0, 0.01 + 0.03 * rng.random() * amount, values.shape)
    return np.asarray(np.clip(255 * values, 0, 255), np.uint8)


def part(photo: RGBPixels, rng: np.random.Generator) -> tuple[Coordinates, float]:
    """Return the (4, 2) corners of a tilted part of a photograph, and its width in pixels."""
    height, width = photo.shape[:2]
    side = rng.uniform(0.25, 0.6) * min(height, width)
    middle = rng.uniform([0.6 * side, 0.5 * side], [width - 0.6 * side, height - 0.5 * side])
    box = 0.62 * side * np.array([[-1, -0.75], [1, -0.75], [1, 0.75], [-1, 0.75]])
    turn = rng.uniform(-np.pi, np.pi) if rng.random() < 0.3 else rng.normal(0, 0.15)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return box * (1 + rng.normal(0, 0.12, (4, 2))) @ rotation.T + middle, 1.24 * side


def made(file: Path, rng: np.random.Generator) -> Pair:
    """Make a pair from a photograph."""
    photo = read_image(file).pixels
    corners, side = part(photo, rng)
    width, height = SIZE
    frame = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]])
    near_from_photo = cv2.getPerspectiveTransform(
        corners.astype(np.float32), frame.astype(np.float32)
    )
    near = cv2.warpPerspective(
        photo, near_from_photo, SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    factor = min(1.0, width / side / float(np.exp(rng.uniform(np.log(1.5), np.log(8)))))
    far = cv2.resize(photo, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    far_from_photo = scaling(far.shape[1] / photo.shape[1], far.shape[0] / photo.shape[0])
    return Pair(
        relit(np.asarray(far), rng, AMOUNTS[0]),
        relit(np.asarray(near), rng, rng.choice(AMOUNTS)),
        far_from_photo @ np.linalg.inv(near_from_photo),
    )


def measured(file: Path, index: int, localizer: Localizer) -> dict[str, Any]:
    """Make a pair, localize it, and return the row."""
    pair = made(file, np.random.default_rng(zlib.crc32(f"made/{index}".encode())))
    found = localizer.localize(pair.far, pair.near)
    row: dict[str, Any] = {
        "case": f"made/{index}",
        "tags": {"base": re.sub(r"(_c\d+)?$", "", file.stem)},
        "set": "made",
        "method": "adaptive",
        "model": "homography",
        "log10_nfa": found.log10_nfa,
        "confidence": found.confidence,
        "agreement": found.agreement,
        "step": found.step,
        "strict": False,
        "seconds": sum(found.seconds.values()),
    }
    if found.far_from_near is None:
        return row
    x, y = (np.linspace(0.05, 0.95, 5) * (length - 1) for length in SIZE)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    away = transform(np.asarray(found.far_from_near), grid) - transform(pair.far_from_near, grid)
    error = float(np.linalg.norm(away, axis=1).mean())
    columns = expected_columns(found.expected_error)
    return row | columns | {"error": error, "strict": error < 3}


def main() -> None:
    """Run and sum up."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--max-effort", default="zoom")
    options = parser.parse_args()
    files = sorted(each for each in options.photos.rglob("*") if each.suffix in (".jpg", ".png"))
    rows = list(read_rows(options.out))
    settings = Settings(
        max_false_alarms=float("inf"), min_confidence=0, max_effort=options.max_effort
    )
    localizer = Localizer(settings)
    with RowFile(options.out) as out:
        for index in range(len(rows), options.pairs):
            rows.append(measured(files[97 * index % len(files)], index, localizer))
            out.append(rows[-1])
    found = sum(row["strict"] for row in rows)
    sure = [row for row in rows if (row["confidence"] or 0) >= 0.5]
    print(f"{len(rows)} made pairs: {found} within 3 pixels; with a confidence of 0.5 or more")
    print(f"{sum(row['strict'] for row in sure)} correct of {len(sure)}")


if __name__ == "__main__":
    main()
