"""The process that writes exports: tasks on its standard input, replies on its standard output.

Packages that formats need change how a process takes signals, and draw under settings that all
threads share: so it is not the server's. It ends when its standard input is closed.
"""

import os
import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nearfar.app.kept import read_matches
from nearfar.app.tasks import Message
from nearfar.errors import ExportError, NearfarError
from nearfar.exports import EXPORTERS, Subject, registered_exporter
from nearfar.imaging.image import Image, ImageInfo, ImagePair, read_image
from nearfar.localization import NO_POINTS, Localization
from nearfar.settings import Settings

WITHOUT_MATCHES = frozenset({"geojson", "kitti", "tum"})
"""Formats in which matched points have no place."""


class ExportTask(Message):
    """Write an answer in some formats.

    Attributes:
        localization: the answer, as `Localization.to_dict` writes it.
        matches: file of its matched points; None where they were not kept.
        far: what the far image is called in files that name it.
        near: what the near image is called in files that name it.
        images: "blank" where only the outcomes are wanted: then pictures are not read.
        formats: names of the formats; empty for all.
        folder: to write into.
        max_pixels: of an image.
    """

    localization: dict[str, Any]
    matches: Path | None
    far: str
    near: str
    images: Literal["blank", "read"]
    formats: tuple[str, ...]
    folder: Path
    max_pixels: int


class Outcome(Message):
    """What became of a format.

    Attributes:
        format: its name.
        file: name of its file or folder; empty where a package is missing.
        files: that were written, relative to the folder of the task.
        reason: why it cannot be written; None where it was.
    """

    format: str
    file: str
    files: tuple[str, ...] = ()
    reason: str | None = None


class Reply(Message):
    """What became of a task.

    Attributes:
        outcomes: of its formats.
        error: why there are none.
    """

    outcomes: tuple[Outcome, ...] = ()
    error: str | None = None


def written(task: ExportTask) -> list[Outcome]:
    """Write an answer; what cannot be written has its reason.

    Raises:
        NearfarError: an image, or what was kept, cannot be read.
    """
    points = NO_POINTS if task.matches is None else read_matches(task.matches)
    found = Localization.from_dict(task.localization, points)
    images = ImagePair(_image(found.far, task), _image(found.near, task))
    subject = Subject(found, None, task.far, task.near, images)
    return [_written(name, subject, task) for name in task.formats or EXPORTERS.names()]


def _image(image: ImageInfo, task: ExportTask) -> Image:
    if task.images == "blank" or image.path is None:
        return Image(np.zeros((1, 1, 3), np.uint8), image.width, image.height, image.path)
    return read_image(image.path, max_size=Settings().max_size, max_pixels=task.max_pixels)


def _written(name: str, subject: Subject, task: ExportTask) -> Outcome:
    file = ""
    try:
        writer = registered_exporter(name)
        file = writer.file_name
        if task.matches is None and name not in WITHOUT_MATCHES:
            raise ExportError(
                "it holds matches, which results of a benchmark do not: localize the pair here"
            )
        files = writer.write(subject, task.folder / file)
    except (NearfarError, OSError) as error:
        return Outcome(format=name, file=file, reason=str(error))
    inside = (each.relative_to(task.folder).as_posix() for each in files)
    return Outcome(format=name, file=file, files=tuple(inside))


def main() -> None:
    """Do tasks until the standard input is closed."""
    # What libraries print must not reach the server as a reply.
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for line in sys.stdin.buffer:
        try:
            reply = Reply(outcomes=tuple(written(ExportTask.model_validate_json(line))))
        except NearfarError as error:
            reply = Reply(error=str(error))
        except Exception as error:
            reply = Reply(error=f"{type(error).__name__}: {error}")
        replies.write(reply.model_dump_json() + "\n")
        replies.flush()


if __name__ == "__main__":
    main()
