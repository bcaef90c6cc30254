"""What the worker process is told and what it tells: one JSON object a line."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

Effort = Literal["points", "landmarks", "zoom", "views"]


class Message(BaseModel):
    """A value that is sent as JSON; unknown names are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class LocalizeTask(Message):
    """Localize a pair.

    Attributes:
        far: the far image.
        near: the near image.
        model: kind of model.
        max_effort: see `Settings`.
        max_pixels: see `Settings`.
        result: file for the answer.
        matches: file for all matched points.
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
        folder: of the map.
        served: the folders in which the images of the map must lie.
        query: the image.
        top: answers that are sought.
        candidates: how many candidates are verified.
        max_pixels: see `Settings`.
        result: file for the answer.
    """

    kind: Literal["locate"] = "locate"
    folder: Path
    served: tuple[Path, ...]
    query: Path
    top: int
    candidates: int
    max_pixels: int
    result: Path


Task = Annotated[LocalizeTask | LocateTask, Field(discriminator="kind")]
TASK: TypeAdapter[LocalizeTask | LocateTask] = TypeAdapter(Task)


class Entered(Message):
    """A stage begins."""

    kind: Literal["entered"] = "entered"
    stage: str


class Tried(Message):
    """A step has fitted its best model so far.

    Attributes:
        step: its name.
        matches: that it had.
        agreeing: that agree with the model.
    """

    kind: Literal["tried"] = "tried"
    step: str
    matches: int
    agreeing: int


class Ended(Message):
    """A task has ended.

    Attributes:
        error: what was wrong with it; None where the answer was written.
        summary: the answer in a few words.
        found: whether it is a place.
    """

    kind: Literal["ended"] = "ended"
    error: str | None = None
    summary: str = ""
    found: bool = False


Report = Annotated[Entered | Tried | Ended, Field(discriminator="kind")]
REPORT: TypeAdapter[Entered | Tried | Ended] = TypeAdapter(Report)
