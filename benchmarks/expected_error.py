"""Count the answers whose expected error is within a factor of 2 of the true one, by data set.

    python benchmarks/expected_error.py --photos PHOTOS --out ROWS.jsonl [--generated 120]
    python benchmarks/expected_error.py --pairs PAIRS --kitti KITTI --sample 40 --out ROWS.jsonl

Generated pairs have exact truth. The far image is a photograph of PHOTOS, reduced 1.5 to 12 times,
tilted in a third of the pairs, in a scene of other photographs. The near image is another view of
it with blur, noise and other brightness: as it is (plane), by a bent lens (lens), of an uneven
surface (depth), or with another photograph over a part (partial). Only answers within 3 pixels or a
tenth of the footprint's diagonal count, or within 5 degrees. The truth of PAIRS has errors of its
own, of about 0.5 to 1 pixel. Rows are appended; cases that are there are skipped.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from nearfar import Localization, Localizer
from nearfar.arrays import Coordinates, RGBPixels
from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.composites import (
    SUFFIXES,
    Backgrounds,
    compose,
    random_generator,
    random_view,
    tilt_homography,
)
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.evaluate import evaluate
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.constants import DEFAULT
from nearfar.geometry.errors import transfer_errors
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.image import read_image
from nearfar.verification.misfit import homography_errors

KINDS = ("plane", "plane", "plane", "lens", "depth", "partial")
"""Half of the generated pairs are planes."""
SIDE = 720
"""Longest side of a photograph, in pixels."""
LOOSE_PX, LOOSE_SHARE = 3.0, 0.1

Row = dict[str, Any]
Seen = Callable[[Coordinates], Coordinates]


def view_of(photo: RGBPixels, kind: str, rng: np.random.Generator) -> Seen:
    """Return what maps near pixels to pixels of a photograph."""
    height, width = photo.shape[:2]
    centre = np.array([width - 1, height - 1]) / 2
    angle = math.radians(float(rng.choice([0, rng.uniform(-30, 30), rng.uniform(-180, 180)])))
    turn = rng.uniform(0.8, 1.25) * np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 0]]
    )
    turn[2, 2] = 1
    tilted = tilt_homography(width, height, rng.uniform(0, 30), axis=rng.uniform(0, 180))
    photo_from_near = np.linalg.inv(translation(*centre) @ turn @ translation(*-centre) @ tilted)
    bend = 10 ** rng.uniform(-2, -0.5) * rng.choice([-1, 1]) if kind == "lens" else 0.0
    size = 10 ** rng.uniform(-2.5, -1.3) * max(width, height) if kind == "depth" else 0.0
    direction = rng.normal(size=2)
    cells = int(rng.integers(2, 7))
    relief = cv2.resize(rng.normal(size=(cells, cells)), (width, height), interpolation=2)
    if rng.random() < 0.5:
        relief = np.where(relief > np.quantile(relief, 0.6), 1.0, 0.0)
    shift = size * direction / np.linalg.norm(direction) / np.abs(relief).max()

    def seen(near: Coordinates) -> Coordinates:
        away = (near - centre) / np.hypot(*centre)
        bent = near + bend * (near - centre) * (away**2).sum(axis=1, keepdims=True)
        inside = np.clip(near, 0, [width - 1, height - 1])
        height_there = map_coordinates(relief, inside.T[::-1], order=1)[:, np.newaxis]
        return np.asarray(transform(photo_from_near, bent) + shift * height_there)

    return seen


def worn(pixels: RGBPixels, rng: np.random.Generator) -> RGBPixels:
    """Blur an image, change its brightness, add noise and compress it."""
    blur = float(rng.choice([0, rng.uniform(0.5, 2.5)]))
    blurred = cv2.GaussianBlur(pixels, (0, 0), blur) if blur else pixels
    values = 255 * (blurred / 255) ** rng.uniform(0.7, 1.4)
    noisy = values + rng.normal(0, rng.uniform(0, 8), values.shape)
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(60, 96))]
    _, file = cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8), quality)
    return np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR), np.uint8)


def covered(near: RGBPixels, other: RGBPixels, rng: np.random.Generator) -> RGBPixels:
    """Return the image with another over 30 to 75 % of it, from a random side."""
    turns, share = int(rng.integers(4)), rng.uniform(0.3, 0.75)
    both = [np.rot90(each, turns).copy() for each in (near, other)]
    rows = int(share * len(both[0]))
    both[0][:rows] = both[1][:rows]
    return np.rot90(both[0], -turns).copy()


def generated(photos: list[Path], scenes: Backgrounds, index: int) -> tuple[str, Row]:
    """Make a pair, localize it, and return its name and row."""
    rng = random_generator(0, "expected error", str(index))
    kind, file = KINDS[index % len(KINDS)], photos[int(rng.integers(len(photos)))]
    photo = read_image(file, max_size=SIDE).pixels
    height, width = photo.shape[:2]
    factor = float(np.exp(rng.uniform(np.log(1.5), np.log(12))))
    view = random_view(width, height, factor, tilted=rng.random() < 0.35, rng=rng)
    far = compose(photo, view, scenes.collage(view.width, view.height, rng))
    seen = view_of(photo, kind, rng)
    grid = places(width, height, 1)
    x, y = seen(grid).reshape(height, width, 2).astype(np.float32).transpose(2, 0, 1)
    near = cv2.remap(photo, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    if kind == "partial":
        near = covered(near, scenes.collage(width, height, rng), rng)
    found = LOCALIZER.localize(worn(far, rng), worn(near, rng))
    at = places(width, height, 7)
    true = transform(view.scene_from_photo, seen(at))
    return f"generated {kind}", {"photo": file.name, "factor": factor} | compared(found, true, at)


def places(width: int, height: int, step: int) -> Coordinates:
    """Return (N, 2) places of an image, evenly."""
    x, y = np.meshgrid(np.arange(0, width, step), np.arange(0, height, step))
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)


def compared(found: Localization, true: Coordinates, at: Coordinates) -> Row:
    """Return the true and the expected mean error of a homography at some places."""
    if found.far_from_near is None or found.expected_error is None:
        return {"true": None}
    model = np.asarray(found.far_from_near)
    error = float(transfer_errors(model, true, at).mean())
    diagonal = float(np.linalg.norm(np.ptp(true, axis=0)))
    if error > max(LOOSE_PX, LOOSE_SHARE * diagonal):
        return {"true": None}
    points, pixel = found.points, found.far.width / found.far.working_size[0]
    expected = homography_errors(
        model,
        points.far[points.inliers],
        points.near[points.inliers],
        (found.near.width, found.near.height),
        at[:: max(1, len(at) // 500)],
        pixel,
        DEFAULT.uncertainty,
    )
    return {"true": error, "expected": float(expected.mean()), "confidence": found.confidence}


def of_case(case: Case) -> tuple[str, Row]:
    """Localize a case of a data set, and return its group and row."""
    found = LOCALIZER.localize(case.far, case.near, model=case.model, intrinsics=case.intrinsics)
    if case.model == "homography":
        return case.group, compared(found, case.far_points, case.near_points)
    columns, expected = evaluate(case, found), found.expected_error
    if expected is None or not columns["loose"]:
        return case.group, {"true": None}
    if case.model == "fundamental":
        return case.group, {"true": columns["error"], "expected": expected.mean}
    row = {
        "true": columns["rotation_degrees"],
        "expected": expected.rotation,
        "true direction": columns["translation_degrees"],
        "expected direction": expected.direction,
    }
    return f"kitti {case.tags['sequence']}", row


def report(rows: list[Row]) -> None:
    """Print the share within a factor of 2 by data set, and the quantiles of the ratio."""
    pairs = [(row["group"], row["expected"], row["true"]) for row in rows if row["true"]]
    pairs += [
        (f"{row['group']}, direction", row["expected direction"], row["true direction"])
        for row in rows
        if row.get("true direction")
    ]
    print("| data set | right answers | within a factor of 2 | expected / true: 10, 50, 90 % |")
    print("|---|---|---|---|")
    names = dict.fromkeys(group for group, _, _ in pairs)
    for name in [*names, "all"]:
        ratio = np.array([value / true for group, value, true in pairs if name in (group, "all")])
        within = float((np.abs(np.log2(ratio)) <= 1).mean())
        low, middle, high = np.quantile(ratio, [0.1, 0.5, 0.9])
        print(f"| {name} | {len(ratio)} | {within:.0%} | {low:.2f}, {middle:.2f}, {high:.2f} |")


def work(arguments: argparse.Namespace) -> Iterator[tuple[str, Callable[[], tuple[str, Row]]]]:
    """Yield the name of each case and what computes its group and row."""
    if arguments.photos:
        photos = sorted(
            file for file in arguments.photos.rglob("*") if file.suffix.lower() in SUFFIXES
        )
        scenes = Backgrounds(arguments.scenes or arguments.photos)
        for index in range(arguments.generated):
            yield f"generated {index}", partial(generated, photos, scenes, index)
    cases = find_pairs(arguments.pairs) if arguments.pairs else []
    if arguments.kitti:
        every = find_kitti_cases(arguments.kitti)
        chosen = np.random.default_rng(0).permutation(len(every))[: arguments.sample]
        cases += [every[index] for index in sorted(chosen)]
    for case in cases:
        yield f"{case.model} {case.group}/{case.name}", partial(of_case, case)


def main() -> None:
    """Localize what is missing, and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--scenes", type=Path)
    parser.add_argument("--generated", type=int, default=120)
    parser.add_argument("--pairs", type=Path)
    parser.add_argument("--kitti", type=Path)
    parser.add_argument("--sample", type=int, default=40)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    rows: list[Row] = []
    if arguments.out.exists():
        rows = [json.loads(line) for line in arguments.out.read_text().splitlines()]
    done = {row["case"] for row in rows}
    with arguments.out.open("a") as out:
        for name, compute in work(arguments):
            if name in done:
                continue
            group, row = compute()
            rows.append({"case": name, "group": group, **row})
            out.write(json.dumps(rows[-1]) + "\n")
            out.flush()
    report(rows)


LOCALIZER = Localizer(budget=4.0)

if __name__ == "__main__":
    main()
