"""Running methods over cases, in parallel, so that nothing already computed is lost."""

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nearfar.bench.datasets.composites import Case
from nearfar.bench.studies.curves import died_row, localized_row
from nearfar.localizer import Localizer
from nearfar.runtime import logs
from nearfar.runtime.metrics import Meter
from nearfar.runtime.progress import shown_progress
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.feature_store import FeatureStore
from nearfar.storage.locations import Location
from nearfar.storage.rows import (
    Row,
    read_rows,
    record_metrics,
    record_run,
    row_file,
    settings_key,
)


@dataclass(frozen=True)
class Task:
    """One case and one method.

    Attributes:
        case: the case.
        settings: the method and its settings.
        key: hash of the settings.
        data: hash of the case's images and ground truth, from `Case.content_hash`.
        descriptor: name of the landmark descriptor; None for a method without landmarks.
        features: folder of the feature store; None keeps features in memory alone.
    """

    case: Case
    settings: Settings
    key: str
    data: str
    descriptor: str | None
    features: Path | None


def run(
    cases: Sequence[Case],
    settings: Sequence[Settings],
    file: Location,
    *,
    workers: Workers | None = None,
    features: Path | None = None,
) -> list[Row]:
    """Localize every case with every setting, skipping what the result file holds already.

    A row counts as done where its settings, its images, its ground truth and the source of plug-ins
    from outside have not changed. Rows of nearfar 0.1.0 do not name their images, which are taken
    as unchanged. The error output tells how many rows are reused. Errors are tried again; of
    several rows of a case and setting the last counts.

    A case that raises an error, or kills its worker, is recorded with the reason, and the run goes
    on. Results are the same for any number of workers, times aside.

    Args:
        cases: the cases.
        settings: one for each method to compare.
        file: JSON Lines, one line a case and setting; made where missing. `run.json` beside it
            tells the settings, the environment, and what each run took.
        workers: where the work is done; None: this process.
        features: folder in which features of images are kept between processes and runs.

    Returns:
        All rows of these cases and settings.

    Raises:
        OSError: a result cannot be written; those before it are kept.
        StorageError: the same in object storage.
    """
    meter = Meter()
    _localizer.cache_clear()  # An earlier run's may hold a plug-in that has changed since.
    rows = {(row["case"], row["settings"]): row for row in read_rows(file)}
    wanted: list[Task] = []
    hashes = [case.content_hash() for case in cases]
    for each in settings:
        key, descriptor = settings_key(each), Localizer(each).descriptor
        wanted += [
            Task(case, each, key, data, descriptor, features)
            for case, data in zip(cases, hashes, strict=True)
        ]
    tasks = {(task.case.name, task.key): task for task in wanted}
    todo = [task for each, task in tasks.items() if not _is_done(rows.get(each), task.data)]
    meter.skipped = len(wanted) - len(todo)
    if meter.skipped:
        logs.say(f"reused {meter.skipped} rows of {file}; to run: {len(todo)}")
    logs.event("run started", results=str(file), todo=len(todo), skipped=meter.skipped)
    with row_file(file) as out, shown_progress("pairs") as show:
        record_run(file.parent, settings)
        for row in (workers or Workers()).run(localize_case, todo, _died, meter):
            identity = row["case"], row["settings"]
            row["data"] = tasks[identity].data
            if row["status"] != "error" or _differs(rows.get(identity), row):
                out.append(row)
                rows[identity] = row
            meter.failed += row["status"] == "error"
            show(meter.done, len(todo))
    metrics = meter.metrics()
    if todo:
        record_metrics(file.parent, file.name, metrics)
    logs.event("run finished", results=str(file), **metrics.to_dict())
    return [rows[task.case.name, task.key] for task in wanted]


def _is_done(row: Row | None, data: str) -> bool:
    """Whether a row is no error and of these images and this ground truth."""
    return row is not None and row["status"] != "error" and row.get("data", data) == data


def _differs(before: Row | None, row: Row) -> bool:
    """Whether an error is another than before, or of other images."""
    return before is None or before["status"] != "error" or before.get("data") != row["data"]


def localize_case(task: Task) -> Row:
    """Localize one case and compare with its truth."""
    return localized_row(task.case, _localizer(task.settings, task.features), task.key)


def _died(task: Task) -> Row:
    """The row of a case that killed its worker."""
    return died_row(task.case, task.settings, task.key, task.descriptor)


@functools.lru_cache(maxsize=1)
def _localizer(settings: Settings, features: Path | None) -> Localizer:
    """The localizer of this process."""
    return Localizer(settings, store=None if features is None else FeatureStore(features))


def scene(name: str) -> str:
    """What the names of pairs of one scene have in common.

    That is the last part of the name without the numbers of the images: "oxford/graf_1_2",
    "oxford/graf_1_3" and "evd/graf" all show the scene "graf", and so do "graf/1_2" and
    "graf/1_10". A longer number after "_" names a photograph: "copr/IMG_0046" is its own scene.
    """
    return re.sub(r"(/1_\d+|(_\d)+)$", "", name).rpartition("/")[2]
