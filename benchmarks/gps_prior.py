"""CPU time of map queries with an expected place, and answers lost where the place is wrong.

Two made flights over the kite photographs' map, whose photographs carry GPS tags: parts of the map,
located by the kite photographs; and half of the kite photographs, located by parts of the others.
Each query is located without an expected place, with one that is half its radius off, and with one
that is 5 radii off.

    python -m benchmarks.gps_prior PAIRS
"""

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage

import nearfar
from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.geometry.homography import transform
from nearfar.maps.world.places import METRES_PER_DEGREE
from nearfar.maps.world.prior import Prior

LATITUDE, LONGITUDE = 34.41, -119.88
METRES = 0.2
"""Size of a pixel of the map, made up."""
RADIUS = 50.0
"""Radius of the expected place in metres, about the size of what a photograph shows."""
OFF = {"right": 0.5, "wrong": 5.0}
"""How far the expected place is off, in radii."""
PART, STEP = 320, 160
"""Side and distance of the parts of the map, in its pixels."""

Photograph = tuple[str, RGBPixels, Coordinates]
"""Name, pixels, and the middle in pixels of the map."""


def main() -> None:
    folder = Path(sys.argv[1]) / "copr"
    flights = {
        "parts of the map": (_parts_of_map(folder), _parts(folder, range(0, 99, 2), 900)),
        "kite photographs": (_reduced(folder), _parts(folder, range(1, 99, 2), 500)),
    }
    with tempfile.TemporaryDirectory() as made:
        for name, (photographs, queries) in flights.items():
            _flight(name, Path(made) / name, list(photographs), list(queries))


def _flight(
    name: str, folder: Path, photographs: list[Photograph], queries: list[Photograph]
) -> None:
    """Print the CPU time of the queries of a flight."""
    for each in photographs:
        _save(folder / "photos", each)
    map_ = nearfar.open_map(folder / "map", create=True)
    map_.add([folder / "photos"])
    random = np.random.default_rng(0)
    spent: dict[str, float] = {}
    found: dict[str, int] = {}
    for query in queries:
        file = _save(folder / "queries", query)
        priors: dict[str, Prior | None] = {"none": None}
        for label, times in OFF.items():
            angle = random.uniform(0, 2 * np.pi)
            moved = times * RADIUS / METRES * np.array([np.cos(angle), np.sin(angle)])
            priors[label] = Prior(*_place(query[2] + moved), RADIUS)
        for label, prior in priors.items():
            began = time.process_time()
            located = map_.locate(file, prior=prior).located
            spent[label] = spent.get(label, 0.0) + time.process_time() - began
            found[label] = found.get(label, 0) + located
    print(f"{name}: {len(photographs)} photographs, {len(queries)} queries")
    for label, seconds in spent.items():
        share = seconds / spent["none"]
        print(f"  {label}: {found[label]} located, {seconds:.1f} CPU s, {share:.2f} of none")


def _parts_of_map(folder: Path) -> Iterator[Photograph]:
    pixels = np.asarray(PillowImage.open(folder / "map.png").convert("RGB"))
    for top in range(0, pixels.shape[0] - PART + 1, STEP):
        for left in range(0, pixels.shape[1] - PART + 1, STEP):
            part = pixels[top : top + PART, left : left + PART]
            if (part.min(axis=2) < 250).mean() > 0.5:
                yield f"{left}-{top}", part, np.array([left, top]) + PART / 2


def _kites(folder: Path) -> list[tuple[str, RGBPixels, Matrix3]]:
    """Name, pixels, and homography to the map, of each kite photograph."""
    found = []
    for case in find_pairs(folder):
        pixels = np.asarray(PillowImage.open(case.near).convert("RGB"))
        homography, _ = cv2.findHomography(case.near_points, case.far_points)
        found.append((case.near.parent.name, pixels, np.asarray(homography)))
    return found


def _reduced(folder: Path) -> Iterator[Photograph]:
    """Yield every second kite photograph, half as large."""
    for name, pixels, homography in _kites(folder)[::2]:
        height, width = pixels.shape[:2]
        small = cv2.resize(pixels, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        yield name, small, transform(homography, np.array([[width / 2, height / 2]]))[0]


def _parts(folder: Path, chosen: range, side: int) -> Iterator[Photograph]:
    """Yield a part of each of some kite photographs, within the map."""
    random = np.random.default_rng(0)
    for number, (name, pixels, homography) in enumerate(_kites(folder)):
        height, width = pixels.shape[:2]
        left, top = random.integers(0, width - side), random.integers(0, height - side)
        middle = transform(homography, np.array([[left, top]]) + side / 2)[0]
        inside = (middle > [100, 80]).all() and (middle < [1730, 690]).all()
        if number in chosen and inside:
            yield name, pixels[top : top + side, left : left + side], middle


def _place(pixel: Coordinates) -> tuple[float, float]:
    """Return latitude and longitude of a pixel of the map."""
    east, north = pixel[0] * METRES, -pixel[1] * METRES
    across = METRES_PER_DEGREE * np.cos(np.radians(LATITUDE))
    return LATITUDE + north / METRES_PER_DEGREE, LONGITUDE + east / across


def _save(folder: Path, photograph: Photograph) -> Path:
    """Write a photograph with GPS tags."""
    name, pixels, middle = photograph
    latitude, longitude = _place(middle)
    exif = PillowImage.Exif()
    exif[0x010F] = "made"
    exif.get_ifd(0x8825).update({1: "N", 2: _dms(latitude), 3: "W", 4: _dms(longitude)})
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.jpg"
    PillowImage.fromarray(pixels).save(file, quality=92, exif=exif)
    return file


def _dms(degrees: float) -> tuple[float, float, float]:
    minutes, seconds = divmod(abs(degrees) * 3600, 60)
    return (*divmod(minutes, 60), round(seconds, 6))


if __name__ == "__main__":
    main()
