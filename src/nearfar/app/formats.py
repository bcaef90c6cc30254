"""Answers in the formats of `nearfar.exports`: which can be had, and their files."""

import contextlib
import io
import os
import posixpath
import subprocess
import sys
import threading
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from nearfar.app.errors import BusyError, ConflictError
from nearfar.app.kept import KeptAnswer
from nearfar.app.library import Library
from nearfar.app.results import crash_explanation
from nearfar.app.writer import ExportTask, Outcome, Reply
from nearfar.exports.subject import ImageNames

SECONDS = 60.0
"""After which an export is given up."""


@dataclass(frozen=True)
class Download:
    """A file to be sent."""

    name: str
    content: bytes


class Formats:
    """Writes answers, one at a time, into folders that are gone afterwards.

    Args:
        library: whose files are named without their places on this machine.
        max_pixels: of an image.
    """

    def __init__(self, library: Library, max_pixels: int) -> None:
        self._library = library
        self._max_pixels = max_pixels
        self._writer = WriterProcess()

    def offered(self, answer: KeptAnswer) -> list[Outcome]:
        """All formats; whether one can be written is found by writing it, with blank images.

        Raises:
            BusyError: another export is under way.
            ConflictError: nothing can be exported.
            ImageError: an image cannot be read.
        """
        with TemporaryDirectory() as folder:
            return self._written(answer, "blank", (), Path(folder))

    def download(self, answer: KeptAnswer, formats: Sequence[str]) -> Download:
        """The file of one format, or a ZIP archive of several files.

        Raises:
            BusyError: another export is under way.
            ConflictError: a format cannot be written.
            ImageError: an image cannot be read.
        """
        with TemporaryDirectory() as folder:
            root = Path(folder)
            outcomes = self._written(answer, "read", tuple(dict.fromkeys(formats)), root)
            for outcome in outcomes:
                if outcome.reason is not None:
                    raise ConflictError(outcome.reason)
            files = [file for outcome in outcomes for file in outcome.files]
            if files == [outcomes[0].file]:
                return Download(files[0], (root / files[0]).read_bytes())
            return Download("exports.zip", _zipped(files, root))

    def close(self) -> None:
        """End the process that writes."""
        self._writer.close()

    def _written(
        self,
        answer: KeptAnswer,
        images: Literal["blank", "read"],
        formats: tuple[str, ...],
        folder: Path,
    ) -> list[Outcome]:
        reply = self._writer.ask(
            ExportTask(
                localization=answer.localization.to_dict(),
                matches=answer.matches,
                far=answer.names.far,
                near=answer.names.near,
                images=images,
                formats=formats,
                folder=folder,
                max_pixels=self._max_pixels,
            )
        )
        if reply.error is not None:
            raise ConflictError(self._said(reply.error, answer))
        return [
            each.model_copy(update={"reason": each.reason and self._said(each.reason, answer)})
            for each in reply.outcomes
        ]

    def _said(self, text: str, answer: KeptAnswer) -> str:
        """A message that calls files by the names that a person knows."""
        found, names = answer.localization, answer.names
        for file, name in ((found.far.path, names.far), (found.near.path, names.near)):
            text = text.replace(str(file), name)
        return self._library.without_places(text)


class WriterProcess:
    """`nearfar.app.writer`, started when it is first needed, and again after it has died."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None

    def ask(self, task: ExportTask) -> Reply:
        """What becomes of a task.

        Raises:
            BusyError: another one is under way.
        """
        if not self._lock.acquire(blocking=False):
            raise BusyError("another export is under way: try again")
        try:
            process = self._started()
            watchdog = threading.Timer(SECONDS, process.kill)
            watchdog.start()
            try:
                line = _answer(process, task)
            finally:
                watchdog.cancel()
            if not line:
                return Reply(error=crash_explanation(process.wait()))
            return Reply.model_validate_json(line)
        finally:
            self._lock.release()

    def close(self) -> None:
        """End it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _started(self) -> "subprocess.Popen[str]":
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "nearfar.app.writer"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                encoding="utf-8",
                start_new_session=True,  # Ctrl+C is for the server, which ends it.
            )
        return self._process


def image_names(library: Library, far: str, near: str) -> ImageNames:
    """What images are called in exports, by their references.

    Their paths relative to the deepest folder that holds both, where one served folder does, else
    the names of their files.
    """
    folder = os.path.commonpath([posixpath.dirname(far), posixpath.dirname(near)])
    if folder.startswith("folder/"):
        names = ImageNames(posixpath.relpath(far, folder), posixpath.relpath(near, folder))
    else:
        names = ImageNames(library.name(far), library.name(near))
    if names.far == names.near:
        return ImageNames(f"far/{names.far}", f"near/{names.near}")
    return names


def _answer(process: "subprocess.Popen[str]", task: ExportTask) -> str:
    """One line; empty where the process has ended."""
    if process.stdin is None or process.stdout is None:
        raise ValueError("the process has no pipes")
    with contextlib.suppress(OSError):
        process.stdin.write(task.model_dump_json() + "\n")
        process.stdin.flush()
    return process.stdout.readline()


def _zipped(files: Sequence[str], root: Path) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(root / file, file)
    return out.getvalue()
