"""What `nearfar bench paper` takes with ResNet-50, without its weights and without all images.

    python benchmarks/paper_cost.py KITTI PHOTOS OUT [--pairs 500]

The weights are made: random values in the layout of ResNet-50. Time does not depend on values, and
nothing is said about accuracy. OUT/kitti gets all used frames of the poses in KITTI; frames that
are not there are links to those that are. OUT/montreal gets 31 pairs in the authors' layout, whose
images are photographs of PHOTOS. Then this runs the command with --dry-run on both. Last, it runs
the KITTI experiment on the first pairs of the real frames, and scales its CPU time to all pairs.
"""

import argparse
import itertools
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import safetensors.numpy
import yaml

from nearfar.arrays import Vectors
from nearfar.bench.studies.kitti import STEP, find_kitti_cases, read_poses
from nearfar.bench.studies.paper import (
    Part,
    descriptors_of,
    estimate_of,
    kitti_cases,
    parts_of,
    run_part,
)
from nearfar.networks.resnet50 import STAGES
from nearfar.presets import PAPER
from nearfar.settings import Settings

MONTREAL_PAIRS = 31
SUFFIXES = {".jpg", ".jpeg", ".png", ".ppm"}
PROJECTIONS = {2: 0.0, 3: -389.0}
"""Fourth value of the made projection of each colour camera, focal length times baseline."""


def made_tensors(seed: int = 0) -> dict[str, Vectors]:
    """Return random weights of ResNet-50 with torchvision's names."""
    rng = np.random.default_rng(seed)
    found: dict[str, Vectors] = {}
    for name, norm, shape in _convolutions():
        spread = np.sqrt(2 / np.prod(shape[1:]))
        found[f"{name}.weight"] = rng.normal(0, spread, shape).astype(np.float32)
        last = name.endswith("conv3")
        for part, value in (("weight", 0.3 if last else 1), ("bias", 0), ("running_mean", 0)):
            found[f"{norm}.{part}"] = np.full(shape[0], value, np.float32)
        found[f"{norm}.running_var"] = np.ones(shape[0], np.float32)
    return found


def _convolutions() -> Iterator[tuple[str, str, tuple[int, int, int, int]]]:
    """Yield the name of each convolution, of its normalization, and the shape of its weights."""
    yield "conv1", "bn1", (64, 3, 7, 7)
    channels = 64
    for stage in STAGES:
        wide = 4 * stage.width
        for block in range(stage.blocks):
            name = f"{stage.layer}.{block}"
            shapes = ((stage.width, channels, 1), (stage.width, stage.width, 3))
            for number, (out, into, side) in enumerate((*shapes, (wide, stage.width, 1)), 1):
                yield f"{name}.conv{number}", f"{name}.bn{number}", (out, into, side, side)
            if block == 0:
                projection = f"{name}.downsample"
                yield f"{projection}.0", f"{projection}.1", (wide, channels, 1, 1)
            channels = wide


def make_kitti(source: Path, folder: Path) -> None:
    """Make the official layout with two cameras and all used frames of the source's poses."""
    images = sorted((source / "sequences").glob("*/image_*/*.png"))
    turn = itertools.cycle(images)
    (folder / "poses").mkdir(parents=True)
    for file in sorted((source / "poses").glob("*.txt")):
        shutil.copy(file, folder / "poses")
        sequence = folder / "sequences" / file.stem
        for camera in PROJECTIONS:
            (sequence / f"image_{camera}").mkdir(parents=True)
        lines = (
            f"P{camera}: 718.856 0 607.193 {last} 0 718.856 185.216 0 0 0 1 0"
            for camera, last in PROJECTIONS.items()
        )
        (sequence / "calib.txt").write_text("\n".join(lines) + "\n")
        for frame in range(0, len(read_poses(file)), STEP):
            here = source / "sequences" / file.stem / "image_0" / f"{frame:06d}.png"
            target = here if here.exists() else next(turn)
            for camera in PROJECTIONS:
                (sequence / f"image_{camera}" / here.name).symlink_to(target.resolve())


def make_montreal(photos: Path, folder: Path) -> None:
    """Make 31 pairs in the authors' layout, ten scenes of three images and one of two."""
    files = sorted(each for each in photos.rglob("*") if each.suffix.lower() in SUFFIXES)
    turn = itertools.cycle(files)
    shares = [[0.1 * (n % 5 + 1), 0.2 * (n // 5 + 1)] for n in range(10)]
    for scene in range(11):
        numbers = (1, 2, 3) if scene < MONTREAL_PAIRS // 3 else (1, 2)
        place = folder / f"scene{scene:02}"
        place.mkdir(parents=True)
        for number in numbers:
            (place / f"{number}.png").symlink_to(next(turn).resolve())
        for first, second in itertools.combinations(numbers, 2):
            smaller = (0.3 + 0.4 * np.array(shares)).tolist()
            text = yaml.safe_dump({str(first): smaller, str(second): shares})
            (place / f"{first}_to_{second}.yaml").write_text(text)


def measure(source: Path, made: Path, part: Part, out: Path, count: int) -> str:
    """Run the KITTI experiment on the first pairs of real frames; return what it costs."""
    there = {case.name for case in find_kitti_cases(source)}
    cases = [case for case in kitti_cases(made) if case.name in there][:count]
    begun = time.process_time()
    rows = run_part(replace(part, cases=tuple(cases)), out, disk_bytes=int(5e9))
    used = time.process_time() - begun
    found = estimate_of(part, rows, (out / f"{part.name}.jsonl").stat().st_size)
    images = len({image for case in cases for image in (case.far, case.near)})
    told = found.image_seconds * images + found.pair_seconds * len(cases)
    hours = found.hours * used / told
    return (
        f"{len(cases)} pairs of {images} frames took {used:.0f} CPU s; all {len(part.cases):,} "
        f"pairs of {part.images:,} frames would take {hours:.1f} CPU hours, {hours / 2:.1f} hours "
        f"on two cores. A frame takes {found.image_seconds * used / told:.2f} CPU s, a pair "
        f"{found.pair_seconds * used / told:.3f} CPU s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kitti", type=Path)
    parser.add_argument("photos", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pairs", type=int, default=500)
    asked = parser.parse_args()
    weights = asked.out / "made-resnet50.safetensors"
    if not weights.exists():
        make_kitti(asked.kitti, asked.out / "kitti")
        make_montreal(asked.photos, asked.out / "montreal")
        safetensors.numpy.save_file(made_tensors(), weights)
    common = Settings().replace(**PAPER.options, weights={"resnet50": weights})
    frames = kitti_cases(asked.out / "kitti")
    part = parts_of([], frames, descriptors_of("resnet50", ()), common)[0]
    print(measure(asked.kitti, asked.out / "kitti", part, asked.out / "timed", asked.pairs))
    command = ["nearfar", "bench", "paper", "--dry-run", "--weights", f"resnet50={weights}"]
    for name in ("kitti", "montreal"):
        command += [f"--{name}", str(asked.out / name)]
    subprocess.run(
        [sys.executable, "-m", *command, "--out", str(asked.out / "dry")],
        check=True,
    )


if __name__ == "__main__":
    main()
