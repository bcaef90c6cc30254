"""What a worker process is told and what it tells: one JSON object a line."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from nearfar.settings import Effort


class Message(BaseModel):
    """A value that is sent as JSON; unknown names are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class LocalizeTask(Message):
    """Localize a pair.

    Attributes:
        far: file of the far image.
        near: file of the near image.
        model: kind of model to estimate.
        max_effort: see `Settings`.
        max_pixels: see `Settings`.
        result: file to write the answer to.
        matches: file to write all matched points to.
    """

    kind: Literal["localize"] = "localize"
    far: Path
    near: Path
    model: Literal["homography", "fundamental"]
    max_effort: Effort
    max_pixels: int
    result: Path
    matches: Path


class LocateTask(Message):
    """Locate an image in a map.

    Attributes:
        folder: folder of the map.
        served: the folders in which the images of the map must lie.
        query: file of the image.
        top: how many answers to seek.
        candidates: how many candidates to verify geometrically.
        max_pixels: see `Settings`.
        result: file to write the answer to.
    """

    kind: Literal["locate"] = "locate"
    folder: Path
    served: tuple[Path, ...]
    query: Path
    top: int
    candidates: int
    max_pixels: int
    result: Path


class ExportTask(Message):
    """Write an answer in some formats.

    Attributes:
        localization: the answer, as `Localization.to_dict` writes it.
        matches: file of its matched points; None where they were not kept.
        far: what the far image is called in files that name it.
        near: what the near image is called in files that name it.
        images: "blank" where only the outcomes are wanted: then no image is read.
        formats: names of the formats; empty for all.
        folder: folder to write into.
        max_pixels: see `Settings`.
    """

    kind: Literal["export"] = "export"
    localization: dict[str, Any]
    matches: Path | None
    far: str
    near: str
    images: Literal["blank", "read"]
    formats: tuple[str, ...]
    folder: Path
    max_pixels: int


WorkerTask = LocalizeTask | LocateTask | ExportTask
TASK: TypeAdapter[WorkerTask] = TypeAdapter(Annotated[WorkerTask, Field(discriminator="kind")])


class StageReport(Message):
    """A stage begins."""

    kind: Literal["stage"] = "stage"
    stage: str


class AttemptReport(Message):
    """A step has fitted its best model so far.

    Attributes:
        step: name of the step.
        matches: number of matches that it had.
        agreeing: number of matches that agree with the model.
    """

    kind: Literal["attempt"] = "attempt"
    step: str
    matches: int
    agreeing: int


class Outcome(Message):
    """What became of one format of an export.

    Attributes:
        format: name of the format.
        file: name of its file or folder; empty where a package is missing.
        files: the files that were written, relative to the folder of the task.
        reason: why the format cannot be written; None where it was.
    """

    format: str
    file: str
    files: tuple[str, ...] = ()
    reason: str | None = None


class Ended(Message):
    """A task has ended.

    Attributes:
        error: what was wrong with it; None where it was done.
        summary: the answer in a few words.
        found: whether the answer is a place.
        outcomes: what became of each format of an export.
    """

    kind: Literal["ended"] = "ended"
    error: str | None = None
    summary: str = ""
    found: bool = False
    outcomes: tuple[Outcome, ...] = ()


Report = StageReport | AttemptReport | Ended
REPORT: TypeAdapter[Report] = TypeAdapter(Annotated[Report, Field(discriminator="kind")])
