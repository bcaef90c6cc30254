"""The rows of a folder of benchmark results, as a table."""

import asyncio
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nearfar.app.configuration import MEGABYTE
from nearfar.app.errors import ConflictError, NotFoundError, TooLargeError
from nearfar.app.formats import KeptAnswer, image_names, localization_of_row
from nearfar.app.library import Library
from nearfar.app.renditions import Renditions
from nearfar.bench.results import Result, load_benchmarks, load_record

LARGEST = 200 * MEGABYTE
"""Largest size of all result files of a folder in bytes."""
MOST_ROWS = 20_000


@dataclass(frozen=True)
class RunRow:
    """One case and method, for the table and the viewer.

    Attributes:
        benchmark: name of the benchmark.
        case: name of the case.
        group: group of cases that results are summed up by.
        method: name of the method, with its descriptor.
        model: kind of model.
        status: "localized", "failed" or "error".
        correct: whether the answer is correct by the strict limit.
        error: error in pixels, or degrees for a pose.
        confidence: calibrated confidence of the answer.
        scale_change: scale change of the estimate.
        true_scale_change: scale change of the case.
        inliers: number of matches that agree with the model.
        matches: number of point matches.
        seconds: total time.
        reason: reason of a failure.
        step: step that found the answer.
        far: reference of the far image; None where it is not in a served folder.
        near: reference of the near image; None where it is not in a served folder.
        homography: maps near to far pixels; None for other models.
        licence: licence of the images.
    """

    benchmark: str
    case: str
    group: str
    method: str
    model: str
    status: str
    correct: bool
    error: float | None
    confidence: float | None
    scale_change: float | None
    true_scale_change: float | None
    inliers: int | None
    matches: int | None
    seconds: float | None
    reason: str | None
    step: str | None
    far: str | None
    near: str | None
    homography: list[list[float]] | None
    licence: str | None


@dataclass(frozen=True)
class Run:
    """Results of benchmarks in one folder.

    Attributes:
        name: name of the folder.
        commands: the commands that wrote the results.
        version: version of nearfar that wrote them.
        rows: all rows, failures first.
        complete: False where there are more rows than are shown.
        skipped: number of lines that could not be read.
    """

    name: str
    commands: tuple[str, ...]
    version: str | None
    rows: list[RunRow]
    complete: bool
    skipped: int


def read_run(folder: Path, library: Library) -> Run:
    """Return the results in a folder.

    Raises:
        BenchmarkError: there are none.
        TooLargeError: the result files are too large.
        ConflictError: a result file is a link.
    """
    results, skipped = _results(folder)
    record = load_record(folder)
    rows = [_row(name, result, folder, library) for name, result in results[:MOST_ROWS]]
    complete = len(results) <= MOST_ROWS
    return Run(folder.name, record.commands, record.version, rows, complete, skipped)


async def kept_row(
    folder: Path, library: Library, renditions: Renditions, index: int, case: str, method: str
) -> KeptAnswer:
    """Return the answer in a row of `read_run`.

    Args:
        folder: folder of results.
        library: the served folders, among them that of the images.
        renditions: the images, for their sizes.
        index: number of the row.
        case: name of the case that the row must have.
        method: name of the method that the row must have.

    Raises:
        BenchmarkError: there are no results.
        NotFoundError: there is no such row any more.
        ConflictError: the images of the row are not in a served folder.
        LocalizationError: the row is damaged.
    """
    results, _ = await asyncio.to_thread(_results, folder)
    for _, result in results[index : index + 1]:
        if (result.case, result.method) != (case, method):
            break
        far, near = (_reference(file, folder, library) for file in (result.far, result.near))
        if far is None or near is None:
            raise ConflictError(
                "the images are elsewhere: start nearfar app with their folder as well"
            )
        names = image_names(library, far, near)
        infos = [await renditions.info(library.file(ref)) for ref in (far, near)]
        return KeptAnswer(localization_of_row(result.row, *infos), None, names)
    raise NotFoundError("there is no such row any more: open the results again")


def _results(folder: Path) -> tuple[list[tuple[str, Result]], int]:
    """Return results with their benchmarks, incorrect ones first; count the damaged lines."""
    for file in (*folder.glob("*.jsonl"), *folder.glob("run.json")):
        if file.is_symlink():
            raise ConflictError(f"{file.name} is a link, which the app does not follow")
    if sum(file.stat().st_size for file in folder.glob("*.jsonl")) > LARGEST:
        raise TooLargeError(f"the results are larger than {LARGEST // MEGABYTE} megabytes")
    benchmarks = load_benchmarks([folder])
    results = [(benchmark.name, result) for benchmark in benchmarks for result in benchmark.results]
    results.sort(key=lambda each: (each[1].strict, each[1].case, each[1].method))
    return results, sum(benchmark.skipped for benchmark in benchmarks)


def _row(benchmark: str, result: Result, folder: Path, library: Library) -> RunRow:
    homography = result.homography
    return RunRow(
        benchmark=benchmark,
        case=result.case,
        group=result.group,
        method=result.method,
        model=result.model,
        status=result.status,
        correct=result.strict,
        error=result.error,
        confidence=result.measures.get("confidence"),
        scale_change=_number(result.row, "scale_change"),
        true_scale_change=result.true_scale_change,
        inliers=_count(result.row, "inliers"),
        matches=_count(result.row, "matches"),
        seconds=sum(result.seconds.values()) if result.seconds else None,
        reason=result.reason,
        step=str(result.row["step"]) if result.row.get("step") else None,
        far=_reference(result.far, folder, library),
        near=_reference(result.near, folder, library),
        homography=None if homography is None else [list(line) for line in homography],
        licence=result.licence,
    )


def _reference(path: Path | None, folder: Path, library: Library) -> str | None:
    """Return the reference of an image that a row names, relative to one of three folders."""
    if path is None:
        return None
    for place in (path, folder / path, folder.parent / path):
        reference = library.reference(place)
        if reference is not None and os.path.isfile(place):  # noqa: PTH113
            return reference
    return None


def _number(row: Mapping[str, Any], name: str) -> float | None:
    value = row.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _count(row: Mapping[str, Any], name: str) -> int | None:
    number = _number(row, name)
    return None if number is None else int(number)
