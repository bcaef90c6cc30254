"""Answers as they are kept, and their files in the formats of `nearfar.exports`."""

import asyncio
import io
import os
import posixpath
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from nearfar.app.configuration import Limits
from nearfar.app.errors import BusyError, ConflictError
from nearfar.app.files import write_whole
from nearfar.app.library import Library
from nearfar.app.process import (
    KILLED,
    Ended,
    ExportAnswer,
    ExportAnswers,
    Outcome,
    WorkerProcess,
    crash_explanation,
)
from nearfar.app.track_tasks import ExportTrack
from nearfar.errors import ExportError, LocalizationError
from nearfar.exports.subject import ImageNames
from nearfar.geometry.homography import footprint
from nearfar.imaging.image import ImageInfo
from nearfar.localization import Localization, PointMatches

_OF_A_ROW = (
    "reason", "model", "far_from_near", "scale_change", "confidence", "log10_nfa",
    "method", "step", "descriptor",
)  # fmt: skip
"""Parts that `Localization.to_dict` and a row of results have in common."""


def kept_localization(content: Any) -> Localization:
    """Return the localization that `Localization.to_dict` has written, without its matches.

    Raises:
        LocalizationError: the content is damaged.
    """
    try:
        return Localization.from_dict(content)
    except LocalizationError:
        raise LocalizationError("what was kept of this answer is damaged") from None


def localization_of_row(row: Mapping[str, Any], far: ImageInfo, near: ImageInfo) -> Localization:
    """Return the localization that a row of benchmark results tells of, without its matches.

    Raises:
        LocalizationError: the row is damaged.
    """
    content = {name: row.get(name) for name in _OF_A_ROW}
    localized = row.get("status") == "localized" and content["far_from_near"] is not None
    content |= {"status": "localized" if localized else "failed", "seconds": {}, "footprint": None}
    if not localized:
        content["far_from_near"] = None
    for role, image in (("far", far), ("near", near)):
        content[role] = {"path": None, "width": image.width, "height": image.height}
    found = replace(kept_localization(content), far=far, near=near)
    if found.model != "homography" or found.far_from_near is None:
        return found
    model = np.asarray(found.far_from_near)
    return replace(found, footprint=footprint(model, near.width, near.height))


@dataclass(frozen=True, eq=False)
class KeptAnswer:
    """A localization that was kept.

    Attributes:
        localization: the answer, without its matches.
        matches: file of its matched points; None where they were not kept.
        names: names of the images in files that name them.
    """

    localization: Localization
    matches: Path | None
    names: ImageNames


def write_matches(file: Path, points: PointMatches) -> None:
    """Keep matched points, all of them and in full precision.

    Raises:
        OSError: the file cannot be written.
    """
    content = io.BytesIO()
    np.savez_compressed(content, far=points.far, near=points.near, inliers=points.inliers)
    write_whole(file, content.getvalue())


def read_matches(file: Path) -> PointMatches:
    """Read the matched points that were kept.

    Raises:
        ExportError: there are none.
    """
    try:
        with np.load(file) as content:
            return PointMatches(content["far"], content["near"], content["inliers"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        raise ExportError(
            "the matches of this answer were not kept: do it again to export it"
        ) from None


SECONDS = 120.0
"""Longest time of an export in seconds."""
ALL_SECONDS = 300.0
"""Longest time of an export of all answers of a batch in seconds."""


@dataclass(frozen=True)
class Download:
    """A file to be sent."""

    name: str
    content: bytes


class Formats:
    """Writes answers, one at a time, into temporary folders.

    Args:
        library: the served folders, whose paths no message shows.
        limits: bounds of the pixels of an image.
    """

    def __init__(self, library: Library, limits: Limits) -> None:
        self._library = library
        self._limits = limits
        self._worker = WorkerProcess()
        self._lock = asyncio.Lock()

    async def offered(self, answer: KeptAnswer) -> list[Outcome]:
        """Try all formats by writing the answer with blank images.

        Raises:
            BusyError: another export is under way.
            ConflictError: nothing can be exported.
            ImageError: an image cannot be read.
        """
        with TemporaryDirectory() as folder:
            return await self._written(answer, "blank", (), Path(folder))

    async def download(self, answer: KeptAnswer, formats: Sequence[str]) -> Download:
        """Write the answer; return the file of one format, or a ZIP archive of several files.

        Raises:
            BusyError: another export is under way.
            ConflictError: a format cannot be written.
            ImageError: an image cannot be read.
        """
        with TemporaryDirectory() as folder:
            root = Path(folder)
            outcomes = await self._written(answer, "read", tuple(dict.fromkeys(formats)), root)
            return await asyncio.to_thread(downloaded, outcomes, root)

    async def download_all(self, answers: Sequence[KeptAnswer], formats: Sequence[str]) -> Download:
        """Write the answers of a batch; return one file, or a ZIP archive of several.

        Formats that hold many answers have one file, others a file in a folder of each answer.

        Raises:
            BusyError: another export is under way.
            ConflictError: a format has no place for the answers.
            ImageError: an image cannot be read.
        """
        names, chosen = _folders(answers), tuple(dict.fromkeys(formats))
        with TemporaryDirectory() as folder:
            root = Path(folder)
            tasks = []
            for name, answer in zip(names, answers, strict=True):
                (root / name).mkdir()
                tasks.append(self._task(answer, "read", chosen, root / name))
            task = ExportAnswers(answers=tuple(tasks), formats=chosen, folder=root)
            ended = await self._ended(task, ALL_SECONDS)
            if ended.error is not None:
                said = ended.error
                for answer in answers:
                    said = self._said(said, answer)
                raise ConflictError(said)
            return await asyncio.to_thread(_download, ended.outcomes, root)

    async def close(self) -> None:
        """End the process that writes."""
        await self._worker.end()

    async def _written(
        self,
        answer: KeptAnswer,
        images: Literal["blank", "read"],
        formats: tuple[str, ...],
        folder: Path,
    ) -> list[Outcome]:
        task = self._task(answer, images, formats, folder)
        return await self.written(task, lambda text: self._said(text, answer))

    async def written(
        self, task: ExportAnswer | ExportTrack, said: Callable[[str], str]
    ) -> list[Outcome]:
        """Do a task of an export.

        Args:
            task: what to write.
            said: returns a message without the folders of this machine.

        Raises:
            BusyError: another export is under way.
            ConflictError: nothing can be exported.
        """
        ended = await self._ended(task, SECONDS)
        if ended.error is not None:
            raise ConflictError(said(ended.error))
        return [
            each.model_copy(update={"reason": each.reason and said(each.reason)})
            for each in ended.outcomes
        ]

    def _task(
        self,
        answer: KeptAnswer,
        images: Literal["blank", "read"],
        formats: tuple[str, ...],
        folder: Path,
    ) -> ExportAnswer:
        return ExportAnswer(
            localization=answer.localization.to_dict(),
            matches=answer.matches,
            far=answer.names.far,
            near=answer.names.near,
            images=images,
            formats=formats,
            folder=folder,
            max_pixels=self._limits.pixels,
            max_tiled_pixels=self._limits.tiled_pixels,
        )

    async def _ended(
        self, task: ExportAnswer | ExportAnswers | ExportTrack, seconds: float
    ) -> Ended:
        if self._lock.locked():
            raise BusyError("another export is under way: try again")
        async with self._lock:
            try:
                async with asyncio.timeout(seconds):
                    return await self._worker.do(task)
            except TimeoutError:
                return Ended(error=crash_explanation(KILLED))

    def _said(self, text: str, answer: KeptAnswer) -> str:
        """Return a message with the names of files that a person knows."""
        found, names = answer.localization, answer.names
        for file, name in ((found.far.path, names.far), (found.near.path, names.near)):
            text = text.replace(str(file), name)
        return self._library.without_places(text)


def image_names(library: Library, far: str, near: str) -> ImageNames:
    """Return the names of two images in exported files, by their references.

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


def _folders(answers: Sequence[KeptAnswer]) -> list[str]:
    """Return the name of a folder for each answer, after its near image."""
    files = [Path(answer.names.near).name for answer in answers]
    stems = [Path(file).stem for file in files]
    names = stems if len(set(stems)) == len(stems) else files
    return (
        names if len(set(names)) == len(names) else [f"{i}-{name}" for i, name in enumerate(names)]
    )


def downloaded(outcomes: Sequence[Outcome], root: Path) -> Download:
    """Return the only file that was written, or a ZIP archive of all.

    Raises:
        ConflictError: a format could not be written.
    """
    for outcome in outcomes:
        if outcome.reason is not None:
            raise ConflictError(outcome.reason)
    return _download(outcomes, root)


def _download(outcomes: Sequence[Outcome], root: Path) -> Download:
    """Return the only file that was written, or a ZIP archive of all."""
    files = [file for outcome in outcomes for file in outcome.files]
    if files == [outcomes[0].file]:
        return Download(files[0], (root / files[0]).read_bytes())
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.write(root / file, file)
    return Download("exports.zip", out.getvalue())
