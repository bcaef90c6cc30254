"""Localizing many pairs: resumable, in parallel, and past images that cannot be read."""

import functools
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nearfar.batch.answers import PairAnswer
from nearfar.batch.pairs import Pair, distinct_names
from nearfar.errors import SettingsError
from nearfar.exports import CollectionExporter, Subject, export_all, exporter
from nearfar.geometry.camera_files import GivenCameras, IntrinsicsSource, read_cameras
from nearfar.localizer import Localizer
from nearfar.models import ModelKind
from nearfar.runtime import logs
from nearfar.runtime.failures import DIED, reason_of_error
from nearfar.runtime.timing import Meter
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.locations import Location
from nearfar.storage.rows import PartedRowFile, Row, RowFile, read_rows, row_file, settings_table
from nearfar.tiled import localize_in_tiles

SUFFIX = ".jsonl"
"""Ending of result files; a file with another ending is never changed."""


@dataclass(frozen=True)
class BatchWork:
    """How each pair of a batch is localized.

    Attributes:
        settings: the method and its settings.
        model: kind of model; None for a pose where both cameras are known, else a homography.
        intrinsics: the cameras of all pairs; None where they are not known.
        far_mask: mask of the far image of all pairs; None for none.
        far_tiles: search windows of the far image where nothing is found.
        exports: formats to write for each pair that is localized; those that have one file for
            many localizations are left to the caller.
        folder: folder of the exports; those of a pair are in a folder named by the near image.
        dem: raster of heights in metres, for exports that tell heights.
    """

    settings: Settings
    model: ModelKind | None = None
    intrinsics: GivenCameras | None = None
    far_mask: Path | None = None
    far_tiles: bool = False
    exports: tuple[str, ...] = ()
    folder: Path | None = None
    dem: Path | None = None

    def key(self) -> str:
        """Return a short hash of all that changes the answers."""
        cameras = self.intrinsics or GivenCameras(None, None)
        content = {
            "settings": settings_table(self.settings),
            "model": self.model,
            "cameras": cameras.to_list(),
            "far_mask": None if self.far_mask is None else str(self.far_mask),
            "far_tiles": self.far_tiles,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]


@dataclass(frozen=True)
class _Task:
    pair: Pair
    name: str
    work: BatchWork


def localize_pairs(
    pairs: Iterable[tuple[str | os.PathLike[str], str | os.PathLike[str]]],
    settings: Settings | None = None,
    *,
    model: ModelKind | None = None,
    intrinsics: IntrinsicsSource | GivenCameras | None = None,
    out: str | os.PathLike[str] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    **options: Any,
) -> Iterator[PairAnswer]:
    """Yield the answer of each pair, in the order of the pairs.

    An image that cannot be read is an answer with an `error`, and the batch goes on.

    Args:
        pairs: far and near image file of each pair.
        settings: the settings; the defaults where None.
        model: "homography", "fundamental" or "pose"; where None, pose with the intrinsics of both
            cameras, and homography without.
        intrinsics: cameras of all pairs, see `Localizer.localize`.
        out: result file, JSON Lines, whose name ends in .jsonl. A line is on the disk before its
            answer is yielded. Pairs that have a line are not localized again: their answers are
            read back, without matches.
        jobs: number of local processes that share the work.
        scheduler: address of a Dask scheduler, whose workers do the work instead.
        **options: settings to change, by name.

    Raises:
        BenchmarkError: the result file holds something else.
        ClusterError: the scheduler cannot be reached, or its workers have other versions.
        IntrinsicsError: the intrinsics are not valid.
        OSError: a line cannot be written; the lines before it are kept.
        SettingsError: an option is not valid, the name of the result file has another ending, or
            the file holds answers of other settings.
        WeightsError: the descriptor needs weights that are missing or do not fit.
    """
    chosen = (settings or Settings()).replace(**options)
    if jobs < 1:
        raise SettingsError(f"jobs must be at least 1, not {jobs}")
    known = None if intrinsics is None else read_cameras(intrinsics)
    files = list(dict.fromkeys(Pair(Path(far), Path(near)) for far, near in pairs))
    file = None if out is None else Path(out)
    return run(files, BatchWork(chosen, model, known), file, Workers(jobs, scheduler))


def run(
    pairs: Sequence[Pair],
    work: BatchWork,
    out: Location | None,
    workers: Workers,
    progress: logs.Progress = logs.silent,
) -> Iterator[PairAnswer]:
    """Yield the answer of each pair, in the order of the pairs; see `localize_pairs`.

    Args:
        pairs: the pairs, each once.
        work: how each pair is localized.
        out: result file; None for none.
        workers: the processes that do the work.
        progress: is told how many pairs are done.
    """
    Localizer(work.settings)  # A setting that is not valid is told before any pair is tried.
    for name in work.exports:
        exporter(name)
    key = work.key()
    rows = {} if out is None else _kept(out, key)
    return _answers(pairs, work, key, rows, out, workers, progress)


def _answers(
    pairs: Sequence[Pair],
    work: BatchWork,
    key: str,
    rows: dict[tuple[str, str], Row],
    out: Location | None,
    workers: Workers,
    progress: logs.Progress,
) -> Iterator[PairAnswer]:
    names = distinct_names([pair.near for pair in pairs])
    every = [_Task(pair, name, work) for pair, name in zip(pairs, names, strict=True)]
    tasks = [task for task in every if _identity(task.pair) not in rows]
    if rows:
        logs.say(f"{len(pairs) - len(tasks)} of {len(pairs)} pairs are in {out} already")
    meter = Meter(skipped=len(pairs) - len(tasks))
    _localizer.cache_clear()  # An earlier batch's may hold a plug-in that has changed since.
    found = workers.run_in_order(_localized, tasks, _died, meter)
    with _opened(out) as file:
        for number, pair in enumerate(pairs, 1):
            row = rows.get(_identity(pair))
            if row is None:
                answer = next(found)
                meter.failed += answer.localization is None
                if file is not None:
                    file.append(answer.to_dict(key))
            else:
                answer = PairAnswer.from_dict(pair, row)
            progress(number, len(pairs))
            yield answer
    logs.event("pairs localized", results=str(out), **meter.metrics().to_dict())


def _opened(out: Location | None) -> AbstractContextManager[RowFile | PartedRowFile | None]:
    return nullcontext() if out is None else row_file(out)


def _kept(out: Location, key: str) -> dict[tuple[str, str], Row]:
    """Return the lines of a result file by the paths of their images.

    Raises:
        SettingsError: the name of the file has another ending, or it has lines of other settings.
    """
    if out.suffix != SUFFIX:
        raise SettingsError(f"results are JSON Lines: give a name that ends in {SUFFIX}, not {out}")
    rows = read_rows(out)
    if any(row.get("settings") != key for row in rows):
        raise SettingsError(
            f"{out} holds answers of other settings, models or cameras: give another --out, or "
            f"remove the file"
        )
    return {(row["far"]["path"], row["near"]["path"]): row for row in rows}


def _identity(pair: Pair) -> tuple[str, str]:
    return str(pair.far), str(pair.near)


def _localized(task: _Task) -> PairAnswer:
    """Localize a pair; whatever is wrong with its images is an answer.

    Raises:
        OSError: the disk is full, which ends the batch.
    """
    pair, work = task.pair, task.work
    try:
        localizer = _localizer(work.settings)
        found = localizer.localize(
            pair.far,
            pair.near,
            model=work.model,
            intrinsics=work.intrinsics,
            far_mask=work.far_mask,
        )
        if work.far_tiles and not found.localized:
            found = localize_in_tiles(
                found, pair.far, pair.near, work.settings, work.far_mask, None
            )
    except Exception as error:  # Libraries raise many kinds of errors for an image.
        return PairAnswer(pair, None, type(error).__name__, reason_of_error(error))
    if work.folder is None or not work.exports or not found.localized:
        return PairAnswer(pair, found)
    folder = work.folder / task.name
    folder.mkdir(parents=True, exist_ok=True)
    formats = [exporter(name) for name in work.exports]
    alone = [each for each in formats if not isinstance(each, CollectionExporter)]
    subject = Subject(found, dem=work.dem)
    return PairAnswer(pair, found, not_exported=export_all(subject, alone, folder).failed)


def _died(task: _Task) -> PairAnswer:
    """Return the answer of a pair that killed every process that took it."""
    return PairAnswer(task.pair, None, "died", f"{task.pair.near}: {DIED}")


@functools.lru_cache(maxsize=1)
def _localizer(settings: Settings) -> Localizer:
    """Return the localizer of this process."""
    return Localizer(settings)
