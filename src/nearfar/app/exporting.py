"""Answers written in the formats of `nearfar.exports`, within a worker process."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from nearfar.app.formats import read_matches
from nearfar.app.parts import large_raster
from nearfar.app.process import ExportAnswer, ExportAnswers, Outcome
from nearfar.app.reasons import in_plain_words
from nearfar.errors import ExportError, NearfarError
from nearfar.exports import (
    EXPORTERS,
    CollectionExporter,
    Subject,
    registered_exporter,
)
from nearfar.imaging.image import Image, ImageInfo, ImagePair, read_image
from nearfar.imaging.tiles import Tile, reduced_size
from nearfar.localization import NO_POINTS, Localization
from nearfar.settings import Settings

NOT_EXPORTED = "not-exported.txt"
"""Name of the file that tells what could not be written."""
WITHOUT_MATCHES = frozenset(
    {"geojson", "geopackage", "geotiff", "kitti", "kml", "kmz", "tum", "world-file"}
)
"""Formats that have no place for matched points."""


def exported(task: ExportAnswer) -> list[Outcome]:
    """Write an answer in each format, or say why a format cannot be written.

    Raises:
        NearfarError: an image, or what was kept, cannot be read.
    """
    names = task.formats or EXPORTERS.names()
    subject = _subject(task, names)
    return [_written(name, subject, task) for name in names]


def exported_all(task: ExportAnswers) -> list[Outcome]:
    """Write answers; what a format has no place for is told in a text file beside the others.

    Raises:
        NearfarError: an image, or what was kept, cannot be read.
        ExportError: a format has no place for any of the answers.
    """
    writers = [registered_exporter(name) for name in task.formats]
    together = [writer for writer in writers if isinstance(writer, CollectionExporter)]
    alone = [writer.name for writer in writers if not isinstance(writer, CollectionExporter)]
    subjects, outcomes, missing = [], [], []
    for answer in task.answers:
        subject = _subject(answer, task.formats)
        subjects.append(subject)
        for outcome in (_written(name, subject, answer) for name in alone):
            outcomes.append(_inside(outcome, answer.folder, task.folder))
            if outcome.reason is not None:
                missing.append(f"{answer.near}: {outcome.format}: {outcome.reason}")
    for each in together:
        files = each.write_all(subjects, task.folder / each.file_name)
        inside = (file.relative_to(task.folder).as_posix() for file in files)
        outcomes.append(Outcome(format=each.name, file=each.file_name, files=tuple(inside)))
    if missing and len(missing) == len(outcomes):
        raise ExportError(missing[0])
    if missing:
        (task.folder / NOT_EXPORTED).write_text("\n".join([*missing, ""]), encoding="utf-8")
        outcomes.append(Outcome(format="text", file=NOT_EXPORTED, files=(NOT_EXPORTED,)))
    return outcomes


def _inside(outcome: Outcome, folder: Path, root: Path) -> Outcome:
    """Return the outcome of an answer with files relative to the folder of all."""
    before = folder.relative_to(root)
    files = tuple((before / file).as_posix() for file in outcome.files)
    return outcome.model_copy(update={"files": files, "reason": None})


def _subject(task: ExportAnswer, names: Sequence[str]) -> Subject:
    points = NO_POINTS if task.matches is None else read_matches(task.matches)
    found = Localization.from_dict(task.localization, points)
    full = any(getattr(EXPORTERS.factory(name), "full_resolution", False) for name in names)
    near = _image(found.near, task, 0 if full else Settings().max_size)
    images = ImagePair(_image(found.far, task, Settings().max_size), near)
    return Subject(found, None, task.far, task.near, images)


def _image(image: ImageInfo, task: ExportAnswer, max_size: int) -> Image:
    if task.images == "blank" or image.path is None:
        return Image(np.zeros((1, 1, 3), np.uint8), image.width, image.height, image.path)
    large = large_raster(image.path, task.max_pixels, task.max_tiled_pixels)
    if large is not None:
        size = reduced_size(image.width, image.height, max_size or Settings().max_size)
        pixels = large.read(Tile(0, 0, image.width, image.height, *size))
        return Image(pixels, image.width, image.height, image.path)
    return read_image(image.path, max_size=max_size, max_pixels=task.max_pixels)


def _written(name: str, subject: Subject, task: ExportAnswer) -> Outcome:
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
        return Outcome(format=name, file=file, reason=in_plain_words(str(error)))
    inside = (each.relative_to(task.folder).as_posix() for each in files)
    return Outcome(format=name, file=file, files=tuple(inside))
