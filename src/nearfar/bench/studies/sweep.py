"""The paper's sweep: method `paper` with every layer and crop size of a network (section IV)."""

import functools
import json
from collections.abc import Callable, Hashable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from nearfar.bench.datasets.cases import Case
from nearfar.bench.evaluate import failure_columns
from nearfar.bench.runner import Task, localize_start, localized_columns, resume
from nearfar.bench.studies.tap_features import NETWORKS, Tap, TapFeatures, TapMethod, taps_of
from nearfar.bench.tables import distinct, markdown
from nearfar.errors import BenchmarkError, SettingsError, WeightsError
from nearfar.localizer import Localizer
from nearfar.networks.weights import weights_file
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.rows import Row, settings_key

NO_WEIGHTS = "weights"
"""Reason for not running a configuration: its weights are missing."""


@dataclass(frozen=True)
class Grid:
    """The configurations of a sweep.

    Attributes:
        network: name of the network.
        layers: outputs of the network; empty for all.
        sizes: sides of the crops in pixels; empty for all.
        sums: further configurations, each of several descriptors joined by "+".

    Raises:
        SettingsError: the network, a layer or a size is unknown.
    """

    network: str
    layers: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()
    sums: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.network not in NETWORKS:
            raise SettingsError(
                f"unknown network {self.network!r}; known networks: {', '.join(NETWORKS)}"
            )
        network = NETWORKS[self.network]
        object.__setattr__(self, "layers", self.layers or network.layers)
        object.__setattr__(self, "sizes", self.sizes or network.sizes)
        for name in self.descriptors:
            taps_of(name)

    @property
    def descriptors(self) -> list[str]:
        """Return the names of all configurations, ordered by size, then by layer."""
        taps = (Tap(self.network, layer, size) for size in self.sizes for layer in self.layers)
        return distinct([tap.name for tap in taps] + list(self.sums))


@dataclass(frozen=True)
class Score:
    """Successes of one configuration on one benchmark.

    Attributes:
        benchmark: name of the benchmark.
        descriptor: the configuration.
        status: whether the configuration was run.
        reason: why it was not run; None where it was.
        cases: number of cases.
        strict: number of strict successes; None where it was not run.
        loose: number of loose successes; None where it was not run.
    """

    benchmark: str
    descriptor: str
    status: Literal["run", "not run"]
    reason: str | None
    cases: int
    strict: int | None
    loose: int | None


@dataclass(frozen=True)
class _Sources:
    """Inputs of all localizers of a sweep.

    Attributes:
        variants: settings of each configuration.
        folder: folder for vectors while they are needed.
        disk_bytes: limit on the size of the vectors.
    """

    variants: tuple[Settings, ...]
    folder: Path
    disk_bytes: int


@dataclass(frozen=True, eq=False)
class _Task(Task):
    sources: _Sources


def run_sweep(
    cases: Sequence[Case],
    grid: Grid,
    settings: Settings,
    file: Path,
    *,
    disk_bytes: int,
    workers: Workers | None = None,
) -> list[Score]:
    """Localize every case with every configuration that has weights; see `resume`.

    Each worker computes the proposals and points of an image once, and runs each network once for
    each size. The rows are those of method `paper`. The time of a shared stage is in the row of the
    first configuration that needed it.

    Args:
        cases: the cases; those that share an image should follow each other.
        grid: the configurations.
        settings: the settings; method and descriptor are replaced.
        file: JSON Lines, one line a case and configuration.
        disk_bytes: limit on the vectors that each worker stores beside the file during the run.
        workers: processes that do the work, one case at a time; None: this process.

    Raises:
        WeightsError: a weights file is damaged or not of its network.
        OSError: the disk is full; the rows before are kept.
    """
    ready = [name for name in grid.descriptors if not _lacks_weights(name, settings)]
    chosen = [settings.replace(method="paper", descriptor=name) for name in ready]
    rows = run_taps(cases, chosen, file, disk_bytes=disk_bytes, workers=workers)
    by_name = {name: rows[index :: len(ready)] for index, name in enumerate(ready)}
    return [
        _score(file.stem, name, by_name[name])
        if name in by_name
        else Score(file.stem, name, "not run", NO_WEIGHTS, len(cases), None, None)
        for name in grid.descriptors
    ]


def run_taps(
    cases: Sequence[Case],
    variants: Sequence[Settings],
    file: Path,
    *,
    disk_bytes: int,
    workers: Workers | None = None,
    together: Callable[[Case], Hashable] = lambda case: case.name,
) -> list[Row]:
    """Localize every case with every variant of the methods `paper` and `objects`; see `resume`.

    Args:
        cases: the cases; those that share an image should follow each other.
        variants: method, descriptor and other settings; only method and descriptor may differ.
        file: JSON Lines, one line a case and variant.
        disk_bytes: limit on the vectors that each worker stores beside the file during the run.
        workers: processes that do the work; None: this process.
        together: the tasks of cases with equal values, which follow each other, go to one worker.

    Returns:
        The rows, those of the variants of each case in turn.

    Raises:
        WeightsError: weights are missing, damaged, or not of their network.
        OSError: the disk is full; the rows before are kept.
    """
    _localizers.cache_clear()
    keys = [settings_key(variant) for variant in variants]
    sources = _Sources(tuple(variants), file.parent, disk_bytes)
    wanted = []
    for case in cases:
        data, failure = case.content_hash(), failure_columns(case)
        for key, variant in zip(keys, variants, strict=True):
            start = localize_start(case, variant, key, variant.descriptor, data)
            wanted.append(_Task(case, variant, start, failure, sources))
    return resume(
        file,
        wanted,
        _columns,
        settings=sources.variants,
        workers=workers,
        together=lambda task: together(task.case),
    )


def _columns(task: _Task) -> Row:
    """Localize one case with one configuration."""
    return localized_columns(task.case, _localizers(task.sources)[task.settings])


def _lacks_weights(descriptor: str, settings: Settings) -> bool:
    """Tell whether weights are neither named nor fetched.

    Raises:
        WeightsError: weights are named, but their file is missing or damaged.
    """
    for network in {tap.network for tap in taps_of(descriptor)}:
        try:
            weights_file(network, settings)
        except WeightsError:
            if network in settings.weights:
                raise
            return True
    return False


@functools.lru_cache(maxsize=1)
def _localizers(sources: _Sources) -> dict[Settings, Localizer]:
    """Make a localizer for each configuration; all of them share their features."""
    some = sources.variants[0]
    taps = [tap for each in sources.variants for tap in taps_of(each.descriptor)]
    features = TapFeatures(taps, some, sources.folder, sources.disk_bytes)
    return {
        each: Localizer(
            each, cache_bytes=0, engine=TapMethod(features, taps_of(each.descriptor), each)
        )
        for each in sources.variants
    }


def _score(benchmark: str, descriptor: str, rows: Sequence[Row]) -> Score:
    strict, loose = (sum(row[name] for row in rows) for name in ("strict", "loose"))
    return Score(benchmark, descriptor, "run", None, len(rows), strict, loose)


def first_pairs(cases: Sequence[Case], sequence: str, count: int) -> list[Case]:
    """Select the first `count` pairs of one KITTI sequence; all for 0.

    Raises:
        BenchmarkError: the sequence has no pairs.
    """
    chosen = [case for case in cases if case.name.startswith(f"{sequence}/")]
    if not chosen:
        raise BenchmarkError(f"there are no pairs of KITTI sequence {sequence!r}")
    return chosen[: count or None]


def sweep_table(grid: Grid, results: Sequence[Score]) -> str:
    """Return, in Markdown, strict successes by layer and size, and of the sums, by benchmark."""
    parts = []
    for benchmark in distinct(result.benchmark for result in results):
        cells = {
            result.descriptor: _cell(result) for result in results if result.benchmark == benchmark
        }
        lines = [
            [layer, *(cells[Tap(grid.network, layer, size).name] for size in grid.sizes)]
            for layer in grid.layers
        ]
        header = [f"{benchmark}: {grid.network}", *(f"{size} px" for size in grid.sizes)]
        parts.append(markdown(header, lines))
        if grid.sums:
            parts.append(
                markdown(
                    [f"{benchmark}: sum", "strict"], [[name, cells[name]] for name in grid.sums]
                )
            )
    return "\n\n".join(parts)


def _cell(result: Score) -> str:
    if result.status == "not run":
        return f"not run: {result.reason}"
    return f"{result.strict} / {result.cases}"


def write_summary(results: Sequence[Score], folder: Path) -> Path:
    """Write the scores to `sweep.json`, and return its path."""
    file = folder / "sweep.json"
    file.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return file
