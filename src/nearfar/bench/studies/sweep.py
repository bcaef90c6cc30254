"""The paper's sweep: every layer and crop size of a network (section IV)."""

import functools
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path

from nearfar.bench.datasets.cases import Case
from nearfar.bench.evaluate import failure_columns
from nearfar.bench.runner import Task, localize_start, localized_columns, resume
from nearfar.bench.studies.sweep_scores import Score, scores
from nearfar.bench.studies.tap_features import NETWORKS, Tap, TapFeatures, TapMethod, taps_of
from nearfar.bench.tables import distinct
from nearfar.errors import BenchmarkError, SettingsError, WeightsError
from nearfar.localizer import Localizer
from nearfar.runtime.weight_files import weights_file
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.rows import Row, settings_key

METHODS = ("paper", "objects")
"""Methods that a sweep can run."""


@dataclass(frozen=True)
class Grid:
    """The configurations of a sweep.

    Attributes:
        network: name of the network.
        layers: outputs of the network; empty for all.
        sizes: sides of the crops in pixels; empty for all.
        sums: further configurations, each of several descriptors joined by "+".
        methods: "paper", "objects", or both.

    Raises:
        SettingsError: the network, a layer, a size or a method is unknown.
    """

    network: str
    layers: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()
    sums: tuple[str, ...] = ()
    methods: tuple[str, ...] = ("paper",)

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
        if unknown := sorted(set(self.methods) - set(METHODS)):
            raise SettingsError(f"a sweep has the methods paper and objects, not {unknown[0]!r}")

    @property
    def descriptors(self) -> list[str]:
        """Return the names of all configurations, ordered by size, then by layer."""
        taps = (Tap(self.network, layer, size) for size in self.sizes for layer in self.layers)
        return distinct([tap.name for tap in taps] + list(self.sums))

    @property
    def configurations(self) -> list[tuple[str, str]]:
        """Return method and descriptor of all configurations, those of one method together."""
        return [(method, name) for method in distinct(self.methods) for name in self.descriptors]


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
    each size. The time of a shared stage is in the row of the first configuration that needed it.

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
    ready = {name for name in grid.descriptors if not _lacks_weights(name, settings)}
    chosen = [each for each in grid.configurations if each[1] in ready]
    variants = [settings.replace(method=method, descriptor=name) for method, name in chosen]
    rows = run_taps(cases, variants, file, disk_bytes=disk_bytes, workers=workers)
    by_name = {each: rows[index :: len(chosen)] for index, each in enumerate(chosen)}
    return scores(file.stem, by_name, grid.configurations, len(cases))


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


def first_pairs(cases: Sequence[Case], sequence: str, count: int) -> list[Case]:
    """Select the first `count` pairs of one KITTI sequence; all for 0.

    Raises:
        BenchmarkError: the sequence has no pairs.
    """
    chosen = [case for case in cases if case.name.startswith(f"{sequence}/")]
    if not chosen:
        raise BenchmarkError(f"there are no pairs of KITTI sequence {sequence!r}")
    return chosen[: count or None]
