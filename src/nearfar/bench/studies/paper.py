"""The paper's experiments as one run: which cases, which configurations, and where the rows go."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.pairs import MONTREAL, find_pairs
from nearfar.bench.runner import run
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.bench.studies.sweep import first_pairs, run_taps
from nearfar.bench.studies.tap_features import NETWORKS, Tap, taps_of
from nearfar.errors import BenchmarkError, SettingsError
from nearfar.presets import KITTI_DESCRIPTOR
from nearfar.runtime.weight_files import weights_file
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.rows import Row, read_rows

LEFT_OUT = ("cartier", "parkShack", "placeDesArts", "parkingLot1")
"""Scenes that the authors' list has as comments."""
SWEEP_SEQUENCE, SWEEP_PAIRS = "00", 1000
"""The paper's sweep is over the first so many pairs of this KITTI sequence."""
FRAMES_TOGETHER = 200
"""Frames of a KITTI sequence, counted with those that are not used, that one worker gets at once:
it computes each used frame once, and ten frames more."""
FEATURE_STAGES = ("proposals", "descriptors", "points")
"""Stages that are computed once for an image."""


@dataclass(frozen=True)
class Part:
    """One of the paper's experiments.

    Attributes:
        name: stem of its result file.
        title: what it is.
        cases: the pairs of images.
        variants: the methods and descriptors.
    """

    name: str
    title: str
    cases: tuple[Case, ...]
    variants: tuple[Settings, ...]

    @property
    def images(self) -> int:
        """Return the number of different images."""
        return len({image for case in self.cases for image in (case.far, case.near)})


@dataclass(frozen=True)
class Descriptors:
    """The descriptors that stand for the paper's.

    Attributes:
        grid: those of the image pairs and of the sweep.
        kitti: those of the KITTI experiment.
    """

    grid: tuple[str, ...]
    kitti: tuple[str, ...]

    @property
    def stand_in(self) -> bool:
        """Whether another descriptor than ResNet-50's stands in."""
        return not all(name.startswith("resnet50") for name in (*self.grid, *self.kitti))


def descriptors_of(network: str, named: Sequence[str]) -> Descriptors:
    """Return the descriptors of a run.

    Args:
        network: network whose layers and sizes are all compared.
        named: descriptors that are compared instead, for every experiment.
    """
    if named:
        return Descriptors(tuple(named), tuple(named))
    layers, sizes = NETWORKS[network].layers, NETWORKS[network].sizes
    grid = tuple(Tap(network, layer, size).name for size in sizes for layer in layers)
    kitti = KITTI_DESCRIPTOR if network == "resnet50" else grid[len(layers) - 1]
    return Descriptors(grid, (kitti,))


def image_pairs(folder: Path, *, all_scenes: bool = False) -> list[Case]:
    """Return the pairs with a homography, without the Montreal scenes that the authors left out.

    Args:
        folder: folder of pairs in any layout.
        all_scenes: keep these scenes.

    Raises:
        BenchmarkError: there are no such pairs.
    """
    found = [
        case
        for case in find_pairs(folder)
        if case.model == "homography" and (all_scenes or not _left_out(case))
    ]
    if not found:
        raise BenchmarkError(f"there are no pairs with a homography in {folder}")
    return found


def _left_out(case: Case) -> bool:
    scene = Path(case.group).name
    return case.tags.get("layout") == MONTREAL and scene in LEFT_OUT


def parts_of(
    pairs: Sequence[Case], frames: Sequence[Case], chosen: Descriptors, common: Settings
) -> list[Part]:
    """Return the parts of the run that its cases allow.

    Args:
        pairs: image pairs, at the paper's size; may be empty.
        frames: pairs of KITTI frames; may be empty.
        chosen: the descriptors.
        common: settings of every method, such as those of a preset.
    """
    sift = common.replace(method="sift", descriptor=Settings().descriptor, weights={})
    parts = []
    if pairs:
        variants = (sift, *_variants(common, chosen.grid))
        parts.append(Part("paper_pairs", "image pairs (Table III)", tuple(pairs), variants))
    if frames:
        variants = (sift, *_variants(common, chosen.kitti))
        parts.append(Part("paper_kitti", "KITTI (Table II)", tuple(frames), variants))
        here = {str(case.tags["sequence"]) for case in frames}
        if SWEEP_SEQUENCE in here and len(chosen.grid) > 1:
            first = tuple(first_pairs(frames, SWEEP_SEQUENCE, SWEEP_PAIRS))
            own = tuple(common.replace(method="paper", descriptor=name) for name in chosen.grid)
            parts.append(Part("paper_sweep", "sweep on KITTI", first, own))
    return parts


def _variants(common: Settings, descriptors: Sequence[str]) -> Iterator[Settings]:
    for name in descriptors:
        for method in ("paper", "objects"):
            yield common.replace(method=method, descriptor=name)


def kitti_cases(folder: Path) -> list[Case]:
    """Return the pairs of KITTI frames, those of one far frame together."""
    return sorted(find_kitti_cases(folder), key=lambda case: case.name)


def check_weights(parts: Sequence[Part]) -> None:
    """Check that the networks of all variants have weights.

    Raises:
        WeightsError: weights are missing or damaged; says how to get them.
    """
    chosen = {each for part in parts for each in part.variants if _is_tap(each)}
    networks = {tap.network: each for each in chosen for tap in taps_of(each.descriptor)}
    for network, settings in networks.items():
        weights_file(network, settings)


def run_part(
    part: Part, out: Path, *, disk_bytes: int, workers: Workers | None = None
) -> list[Row]:
    """Run one part; rows that are there are kept, see `nearfar.bench.runner.resume`.

    Args:
        part: the part.
        out: folder of the results.
        disk_bytes: limit on the vectors that each worker stores in the folder during the run.
        workers: processes that do the work; None: this process.

    Returns:
        All rows of the part's file.

    Raises:
        WeightsError: weights are missing, damaged, or not of their network.
        OSError: the disk is full; the rows before are kept.
    """
    file = out / f"{part.name}.jsonl"
    taps = [each for each in part.variants if _is_tap(each)]
    others = [each for each in part.variants if not _is_tap(each)]
    if taps:
        run_taps(
            part.cases,
            taps,
            file,
            disk_bytes=disk_bytes,
            workers=workers,
            together=_block,
        )
    if others:
        run(part.cases, others, file, workers=workers, features=out / "features")
    return read_rows(file)


def _is_tap(settings: Settings) -> bool:
    """Tell whether a variant's descriptor consists of outputs of networks."""
    if settings.method == "sift":
        return False
    try:
        return bool(taps_of(settings.descriptor))
    except SettingsError:
        return False


def _block(case: Case) -> str:
    """Return a name that cases share which one worker gets at once."""
    if case.model != "pose":
        return case.name
    sequence, _, frames = case.name.partition("/")
    return f"{sequence}/{int(frames.partition('-')[0]) // FRAMES_TOGETHER}"


@dataclass(frozen=True)
class Estimate:
    """What a part would take, from pairs that were run.

    Attributes:
        part: the part.
        image_seconds: time for the features of one image, by all configurations, in seconds.
        pair_seconds: time for one pair, by all methods and configurations, in seconds.
        row_bytes: size of one row of results.
    """

    part: Part
    image_seconds: float
    pair_seconds: float
    row_bytes: float

    @property
    def hours(self) -> float:
        """Return the hours of one process for the whole part."""
        part = self.part
        total = self.image_seconds * part.images + self.pair_seconds * len(part.cases)
        return total / 3600

    @property
    def gigabytes(self) -> float:
        """Return the size of the rows of the whole part."""
        return self.row_bytes * len(self.part.cases) * len(self.part.variants) / 1e9


def estimated(part: Part, *, disk_bytes: int) -> Estimate:
    """Run a part's pair in the middle in a temporary folder, and return what all would take."""
    middle = part.cases[len(part.cases) // 2]
    with tempfile.TemporaryDirectory() as folder:
        rows = run_part(replace(part, cases=(middle,)), Path(folder), disk_bytes=disk_bytes)
        size = (Path(folder) / f"{part.name}.jsonl").stat().st_size
    return estimate_of(part, rows, size)


def estimate_of(part: Part, rows: Sequence[Row], size: int) -> Estimate:
    """Return what a part would take, from the rows of some of its pairs.

    Args:
        part: the part.
        rows: rows of all variants for the same pairs.
        size: size of these rows in bytes.
    """
    shared, own = 0.0, 0.0
    for row in rows:
        for stage, seconds in (row.get("seconds") or {}).items():
            if stage in FEATURE_STAGES:
                shared += seconds
            else:
                own += seconds
    pairs = len({row["case"] for row in rows})
    images = len({row[side] for row in rows for side in ("far", "near")})
    return Estimate(part, shared / images, own / pairs, size / len(rows))
