"""Batches: a folder of close-ups on one overview, one job each, and their table."""

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from nearfar.app.choices import Device, MatcherName
from nearfar.app.errors import ConflictError, NotFoundError
from nearfar.app.jobs import Job, JobStore, LocalizeRequest, Reference
from nearfar.app.library import Library
from nearfar.app.process import Areas, Message
from nearfar.settings import Effort
from nearfar.storage.spreadsheets import spreadsheet_cell

MOST = 100
"""Largest number of close-ups of a batch."""
COLUMNS = (
    "near", "far", "state", "scale_change", "confidence", "expected_error",
    "expected_error_worst_corner", "warning", "explanation", "model", "failure", "reason",
    "far_from_near", "footprint",
)  # fmt: skip
"""Columns of the table that is exported."""


class BatchRequest(Message):
    """Localize all images of a folder in one overview; see `LocalizeRequest`."""

    far: Reference
    folder: Reference
    model: Literal["homography", "fundamental"] = "homography"
    max_effort: Effort = Field(default="views")
    matcher: MatcherName = "sift"
    device: Device = "auto"
    far_mask: Areas = ()


@dataclass(frozen=True)
class Batch:
    """The jobs of a batch, failures first.

    Attributes:
        id: 16 hexadecimal digits.
        jobs: its jobs: errors, then pairs that were not found, those under way, and those found.
    """

    id: str
    jobs: list[Job]


def requests_of(request: BatchRequest, library: Library) -> list[LocalizeRequest]:
    """Return one request for each image of the folder beside the overview.

    Raises:
        NotFoundError: the overview or the folder is not there.
        ConflictError: the folder has no image, or too many.
    """
    library.file(request.far)
    listing = library.listing(request.folder)
    images = [each.ref for each in listing.images if each.ref != request.far]
    if listing.total > len(listing.images) + len(listing.folders) or len(images) > MOST:
        raise ConflictError(
            f"the folder has more than {MOST} images: use several folders, or nearfar localize"
        )
    if not images:
        raise ConflictError("the folder has no image to look for: choose another one")
    options = request.model_dump(exclude={"folder"})
    return [LocalizeRequest(near=near, **options) for near in images]


def opened_batch(store: JobStore, batch: str) -> Batch:
    """Return a batch.

    Raises:
        NotFoundError: there is none.
    """
    jobs = [job for job in store.all() if job.batch == batch]
    if not batch or not jobs:
        raise NotFoundError("there is no such batch")
    return Batch(batch, sorted(jobs, key=lambda job: (_rank(job), job.names)))


def _rank(job: Job) -> int:
    if job.active:
        return 2
    return (3 if job.found else 1) if job.status == "done" else 0


def exported_batch(store: JobStore, jobs: Iterable[Job], layout: Literal["csv", "jsonl"]) -> str:
    """Return all answers of a batch as a table, or as JSON lines with all that is known."""
    rows = [_row(store, job) for job in jobs]
    if layout == "jsonl":
        return "".join(json.dumps(row) + "\n" for row in rows)
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(COLUMNS)
    writer.writerows([_cell(row.get(name)) for name in COLUMNS] for row in rows)
    return out.getvalue()


def _row(store: JobStore, job: Job) -> dict[str, Any]:
    far, near = job.names
    row: dict[str, Any] = {"state": job.outcome, "status": job.status, "reason": job.error}
    if job.status == "done":
        result = store.result(job.id)
        row |= {name: result.get(name) for name in ("explanation", "warning")}
        row |= result["localization"]
        corners = (row.get("expected_error") or {}).get("corners")
        row["expected_error_worst_corner"] = max(corners) if corners else None
    return row | {"far": far, "near": near}


def _cell(value: Any) -> str:
    """Return a value as text that no spreadsheet takes for a formula; of an object the first."""
    if isinstance(value, dict):
        (value,) = list(value.values())[:1] or [None]
    if isinstance(value, Sequence) and not isinstance(value, str):
        value = json.dumps(value)
    return spreadsheet_cell(value)
