"""What `nearfar bench paper` takes with ResNet-50, without its weights and without all images.

    python benchmarks/paper_cost.py KITTI PHOTOS OUT [--pairs 500] [--frames 8] [--no-dry-run]

The weights are made: random values in the layout of ResNet-50. Time does not depend on values, and
nothing is said about accuracy. OUT/kitti gets all used frames of the poses in KITTI; frames that
are not there are links to those that are. OUT/montreal gets 31 pairs in the authors' layout, whose
images are photographs of PHOTOS.

First the KITTI experiment runs on all pairs among a few real frames. That gives the CPU time of a
crop, of the keypoints of a frame, and of a pair. Then the boxes of all frames of many pairs are
proposed and counted. Crops take nearly all of the time, so the number of boxes decides: the cost of
a frame is that of its proposals, its keypoints and so many crops as the counted frames have in the
mean. Last, this runs the command with --dry-run on both folders.
"""

import argparse
import itertools
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import safetensors.numpy
import yaml

from nearfar.arrays import Vectors
from nearfar.bench.datasets.cases import Case
from nearfar.bench.studies.kitti import STEP, find_kitti_cases, read_poses
from nearfar.bench.studies.paper import (
    Part,
    descriptors_of,
    kitti_cases,
    parts_of,
    run_part,
)
from nearfar.imaging.image import read_image
from nearfar.networks.resnet50 import STAGES
from nearfar.presets import PAPER
from nearfar.proposals import PROPOSERS
from nearfar.settings import Settings
from nearfar.storage.rows import Row, RowFile, read_rows

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


@dataclass(frozen=True)
class Cost:
    """CPU seconds of the parts of the KITTI experiment.

    Attributes:
        crop: the descriptor of one box.
        points: keypoints of a frame.
        pair: matching and estimation of a pair by all methods.
    """

    crop: float
    points: float
    pair: float


def cost_of(rows: Sequence[Row], boxes: int, used: float) -> Cost:
    """Return the cost of the parts of a run.

    Stages are timed by the clock, which other work on the machine makes slow. So they share the
    CPU time of the run by their part of all stages.

    Args:
        rows: the rows of the run.
        boxes: boxes of all its frames together.
        used: CPU seconds of the run without its proposals.
    """
    spent: dict[str, float] = {}
    for row in rows:
        for stage, seconds in row["seconds"].items():
            spent[stage] = spent.get(stage, 0.0) + seconds
    del spent["proposals"]
    rate = used / sum(spent.values())
    frames = len({row[side] for row in rows for side in ("far", "near")})
    crops, points = (spent.pop(stage) * rate for stage in ("descriptors", "points"))
    pairs = len({row["case"] for row in rows})
    return Cost(crops / boxes, points / frames, sum(spent.values()) * rate / pairs)


def count_boxes(images: Sequence[Path], settings: Settings, file: Path) -> list[Row]:
    """Return the number of boxes of each image and the CPU seconds of its proposals.

    Args:
        images: the images.
        settings: settings of the proposals.
        file: JSON Lines with what is counted; a run that was stopped goes on.
    """
    search = PROPOSERS.create(settings.proposer, settings)
    counted = {row["image"]: row for row in read_rows(file)}
    with RowFile(file) as out:
        for image in map(str, images):
            if image not in counted:
                pixels = read_image(image).pixels
                begun = time.process_time()
                boxes = len(search.propose(pixels))
                row = {"image": image, "boxes": boxes, "seconds": time.process_time() - begun}
                out.append(row)
                counted[image] = row
    return [counted[str(image)] for image in images]


def measure(cases: Sequence[Case], part: Part, out: Path, frames: int) -> str:
    """Run the KITTI experiment on a few frames, count the boxes of all, and return what it costs.

    Args:
        cases: pairs of real frames, whose boxes are counted.
        part: the experiment with all its pairs.
        out: folder for the rows.
        frames: number of frames that are run.
    """
    images = list(dict.fromkeys(image for case in cases for image in (case.far, case.near)))
    some = set(images[:frames])
    few = tuple(case for case in cases if {case.far, case.near} <= some)
    out.mkdir(parents=True, exist_ok=True)
    counted = count_boxes(images, part.variants[0], out / "boxes.jsonl")
    counts = [int(row["boxes"]) for row in counted]
    proposal = float(np.mean([row["seconds"] for row in counted]))
    folder = out / f"frames-{frames}"
    if folder.exists():
        raise SystemExit(f"{folder} is of an earlier run, whose time is not known: remove it")
    begun = time.process_time()
    rows = run_part(replace(part, cases=few), folder, disk_bytes=int(5e9))
    used = time.process_time() - begun - proposal * len(some)
    cost = cost_of(rows, sum(counts[:frames]), used)
    boxes = float(np.mean(counts))
    frame = proposal + cost.points + boxes * cost.crop
    hours = (frame * part.images + cost.pair * len(part.cases)) / 3600
    return (
        f"{len(few)} pairs of {len(some)} frames were run, {len(cases)} pairs of {len(images)} "
        f"frames counted: {boxes:.0f} boxes a frame ({min(counts)} to {max(counts)}). CPU seconds: "
        f"{cost.crop:.4f} a crop, {proposal:.2f} the proposals and {cost.points:.2f} the keypoints "
        f"of a frame, {cost.pair:.2f} a pair. All {len(part.cases):,} pairs of {part.images:,} "
        f"frames: {hours:.1f} CPU hours, {hours / 2:.1f} hours on two cores"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kitti", type=Path)
    parser.add_argument("photos", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--pairs", type=int, default=500, help="pairs whose boxes are counted")
    parser.add_argument("--frames", type=int, default=8, help="frames that are run")
    parser.add_argument("--descriptor", nargs="*", default=[], help="of the dry run, not all 24")
    parser.add_argument("--dry-run", action=argparse.BooleanOptionalAction, default=True)
    asked = parser.parse_args()
    weights = asked.out / "made-resnet50.safetensors"
    if not weights.exists():
        make_kitti(asked.kitti, asked.out / "kitti")
        make_montreal(asked.photos, asked.out / "montreal")
        safetensors.numpy.save_file(made_tensors(), weights)
    common = Settings().replace(**PAPER.options, weights={"resnet50": weights})
    every = kitti_cases(asked.out / "kitti")
    part = parts_of([], every, descriptors_of("resnet50", ()), common)[0]
    there = {case.name for case in find_kitti_cases(asked.kitti)}
    cases = [case for case in every if case.name in there][: asked.pairs]
    print(measure(cases, part, asked.out / "timed", asked.frames), flush=True)
    if not asked.dry_run:
        return
    command = ["nearfar", "bench", "paper", "--dry-run", "--weights", f"resnet50={weights}"]
    for name in ("kitti", "montreal"):
        command += [f"--{name}", str(asked.out / name)]
    for name in asked.descriptor:
        command += ["--descriptor", name]
    subprocess.run(
        [sys.executable, "-m", *command, "--out", str(asked.out / "dry")],
        check=True,
    )


if __name__ == "__main__":
    main()
