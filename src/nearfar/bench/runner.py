"""The one runner of all benchmarks: compute the rows that a result file lacks, in parallel."""

import functools
import itertools
import json
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from nearfar.bench.datasets.cases import Case
from nearfar.bench.evaluate import evaluate, failure_columns
from nearfar.bench.results import Result
from nearfar.errors import BenchmarkError
from nearfar.localizer import Localizer
from nearfar.runtime import logs
from nearfar.runtime.failures import DIED, reason_of_error
from nearfar.runtime.logs import shown_progress
from nearfar.runtime.timing import Meter
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
from nearfar.verification.expected_error import ExpectedError

_KEPT = (
    "status",
    "reason",
    "far_from_near",
    "inliers",
    "matches",
    "landmark_matches",
    "scale_change",
    "log10_nfa",
    "confidence",
    "agreement",
    "step",
    "seconds",
)
"""Columns of a localization that its row keeps."""


@dataclass(frozen=True, eq=False)
class Task:
    """One row to compute.

    Attributes:
        case: the case.
        settings: the method and its settings.
        start: columns known beforehand: case, settings, and `data`, the hash of images and truth.
        failure: columns of a row without a result.
    """

    case: Case
    settings: Settings
    start: Row
    failure: Row


T = TypeVar("T", bound=Task)


def resume(
    file: Location,
    wanted: Sequence[T],
    compute: Callable[[T], Row],
    *,
    settings: Sequence[Settings],
    identity: tuple[str, ...] = ("case", "settings"),
    workers: Workers | None = None,
    together: Callable[[T], Hashable] | None = None,
) -> list[Row]:
    """Compute the rows that a result file lacks, and append each as soon as it is there.

    A row is reused if its settings, its images, its ground truth and the source of plug-ins from
    outside have not changed. Rows of nearfar 0.1.0 do not name their images, which count as
    unchanged. Rows with errors are retried. The error output tells how many rows are reused and
    retried. The last of several rows with the same identity counts.

    A task that raises an error or kills its worker gets a row with the reason, and the run goes
    on. Apart from times, results do not depend on the number of workers.

    Args:
        file: JSON Lines; made where missing, with settings and metrics in `run.json` beside it.
        wanted: a task for each row.
        compute: returns the remaining columns of a row, `status` among them; a module's function.
        settings: all settings of the run, for `run.json`.
        identity: the columns that identify a row.
        workers: processes that do the work; None: this process.
        together: the tasks with equal values, which follow each other, go to one worker at once.

    Returns:
        The rows of the tasks, in the order of the tasks.

    Raises:
        OSError: a row cannot be written; the rows before it are kept.
        StorageError: the object storage of the file does not answer.
    """
    meter = Meter()
    rows = {_identity(row, identity): row for row in read_rows(file)}
    tasks = {_identity(task.start, identity): task for task in wanted}
    todo = {each: task for each, task in tasks.items() if not _is_done(rows.get(each), task)}
    meter.skipped = len(wanted) - len(todo)
    before = [rows[each] for each in todo if each in rows]
    _say_what_is_reused(file, meter.skipped, len(todo), before)
    groups = itertools.groupby(todo.values(), together)
    batches = [tuple(own) for _, own in groups]
    with row_file(file) as out, shown_progress("pairs") as show:
        record_run(file.parent, settings)
        work = functools.partial(_rows, compute)
        for found in (workers or Workers()).run(work, batches, _died, meter):
            for row in found:
                each = _identity(row, identity)
                if not _is_error(row) or _is_new_error(row, rows.get(each)):
                    out.append(row)
                    rows[each] = row
            meter.failed += any(map(_is_error, found))
            show(meter.done, len(batches))
    if todo:
        record_metrics(file.parent, file.name, meter.metrics())
    logs.event("run finished", results=str(file), **meter.metrics().to_dict())
    return [rows[_identity(task.start, identity)] for task in wanted]


def _say_what_is_reused(file: Location, reused: int, todo: int, before: Sequence[Row]) -> None:
    """Tell how many rows are reused, and how many of those to compute are in the file.

    Args:
        file: the result file.
        reused: number of rows that are reused.
        todo: number of rows to compute.
        before: the rows in the file that are computed again.
    """
    if reused or before:
        errors = sum(map(_is_error, before))
        logs.say(
            f"reused {reused} rows of {file}; to run: {todo}, among them {errors} with errors "
            f"before and {len(before) - errors} with changed images"
        )
    logs.event("run started", results=str(file), todo=todo, skipped=reused)


def _identity(row: Row, columns: tuple[str, ...]) -> tuple[Hashable, ...]:
    return tuple(row[column] for column in columns)


def _is_error(row: Row | None) -> bool:
    return row is not None and row["status"] == "error"


def _is_done(row: Row | None, task: Task) -> bool:
    """Tell whether a row has no error and belongs to the task's images and ground truth."""
    if row is None or _is_error(row):
        return False
    data: str = task.start["data"]
    return bool(row.get("data", data) == data)


def _is_new_error(row: Row, before: Row | None) -> bool:
    """Tell whether the row before had no error, or belonged to other images."""
    return before is None or not _is_error(before) or before.get("data") != row["data"]


def _rows(compute: Callable[[T], Row], tasks: Sequence[T]) -> list[Row]:
    """Compute the rows of tasks; a failure of one task is recorded in its row.

    Raises:
        OSError: the disk is full, which ends the run.
    """
    return [task.start | _columns(compute, task) for task in tasks]


def _columns(compute: Callable[[T], Row], task: T) -> Row:
    try:
        return compute(task)
    except Exception as error:  # Libraries and plug-ins raise many kinds of errors.
        return _failure(task, reason_of_error(error))


def _failure(task: Task, reason: str) -> Row:
    return task.failure | {"status": "error", "reason": reason}


def _died(tasks: Sequence[Task]) -> list[Row]:
    """Return the rows of tasks that killed their worker."""
    return [task.start | _failure(task, DIED) for task in tasks]


@dataclass(frozen=True, eq=False)
class LocalizeTask(Task):
    """A case to localize.

    Attributes:
        measure: case, method -> columns of the row.
        features: folder of the feature store; None keeps features in memory alone.
    """

    measure: Callable[[Case, Localizer], Row]
    features: Path | None


def localized_columns(case: Case, localizer: Localizer) -> Row:
    """Localize a case, and return the columns of the answer and of its errors."""
    found = localizer.localize(
        case.far,
        case.near,
        model=case.model,
        intrinsics=case.intrinsics,
        far_mask=case.far_mask,
        near_mask=case.near_mask,
    )
    answer = found.to_dict()
    kept = {name: answer[name] for name in _KEPT} | expected_columns(found.expected_error)
    return kept | evaluate(case, found)


def expected_columns(expected: ExpectedError | None) -> Row:
    """Return the expected error of an answer as columns of its row."""
    region = None if expected is None else expected.region
    return {
        "expected_error": None if expected is None else expected.value,
        "expected_inside": None if region is None else region.inside,
    }


def run(
    cases: Sequence[Case],
    settings: Sequence[Settings],
    file: Location,
    *,
    workers: Workers | None = None,
    features: Path | None = None,
    measure: Callable[[Case, Localizer], Row] = localized_columns,
    code: str = "",
) -> list[Result]:
    """Run every setting on every case, by default to localize and compare; see `resume`.

    Args:
        cases: the cases.
        settings: one for each method to compare.
        file: JSON Lines, one line a case and setting.
        workers: processes that do the work; None: this process.
        features: folder in which features of images are kept between processes and runs.
        measure: case, method -> columns of the row; a function of a module.
        code: hash of the source of `measure` where it is not of this package, else empty.

    Returns:
        The results of these cases and settings.

    Raises:
        OSError: a row cannot be written; the rows before it are kept.
        StorageError: the object storage of the file does not answer.
    """
    _localizer.cache_clear()  # An earlier run's may hold a plug-in that has changed since.
    wanted = []
    hashes = [f"{case.content_hash()}{code[:16]}" for case in cases]
    for each in settings:
        key, descriptor = settings_key(each), Localizer(each).descriptor
        for case, data in zip(cases, hashes, strict=True):
            start = localize_start(case, each, key, descriptor, data)
            failure = failure_columns(case)
            wanted.append(LocalizeTask(case, each, start, failure, measure, features))
    rows = resume(file, wanted, localize_case, settings=settings, workers=workers)
    return [Result.from_dict(row) for row in rows]


def localize_start(
    case: Case, settings: Settings, key: str, descriptor: str | None, data: str
) -> Row:
    """Return the columns of a localized case that are known beforehand.

    Args:
        case: the case.
        settings: the method and its settings.
        key: hash of the settings, from `settings_key`.
        descriptor: name of the landmark descriptor; None for a method without landmarks.
        data: hash of images and ground truth, from `Case.content_hash`.
    """
    return {
        "case": case.name,
        "group": case.group,
        "tags": dict(case.tags),
        "far": str(case.far),
        "near": str(case.near),
        "model": case.model,
        "true_scale_change": case.scale_change,
        "method": settings.method,
        "descriptor": descriptor,
        "settings": key,
        "data": data,
    }


def localize_case(task: LocalizeTask) -> Row:
    """Run one method on one case.

    Raises:
        BenchmarkError: the columns are no table for JSON.
    """
    columns = task.measure(task.case, _localizer(task.settings, task.features))
    try:
        json.dumps(dict(columns), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise BenchmarkError(
            f"a study must return a table of columns for JSON, with finite numbers: {error}"
        ) from error
    return {"status": "localized", "reason": None} | columns


@functools.lru_cache(maxsize=1)
def _localizer(settings: Settings, features: Path | None) -> Localizer:
    """Return the localizer of this process."""
    return Localizer(settings, store=None if features is None else FeatureStore(features))
