"""Image files -> what a map holds of them, only for those that are new or have changed."""

import functools
import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearfar.bench.workers import Workers
from nearfar.errors import ImageError
from nearfar.geometry.homography import transform
from nearfar.maps.files import content_hash, name_of
from nearfar.maps.keypoints import packed_keypoints
from nearfar.maps.landmarks import LandmarkDescriber, Landmarks, finer_scales, whole_scales
from nearfar.maps.sources import Core, Tile, levels, open_image
from nearfar.maps.store import OK, Indexed, MapImage, MapStore
from nearfar.settings import Settings

LANDMARKS_PER_COMMIT = 50_000
"""Images are committed together until they have so many; what a crash can lose."""

Progress = Callable[[int, int], None]
"""Is told how many of how many images are done."""


@dataclass(frozen=True)
class Added:
    """What adding images did.

    Attributes:
        added: images that are new.
        replaced: images whose content had changed, or that could not be read before.
        unchanged: images that were there already.
        failed: name and reason of those that could not be read.
    """

    added: int
    replaced: int
    unchanged: int
    failed: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Task:
    file: Path
    name: str
    sha256: str
    max_size: int
    settings: Settings


def add_images(
    store: MapStore, files: Iterable[Path], settings: Settings, jobs: int, progress: Progress
) -> Added:
    """Add files to a map; must be called within `MapStore.writing`.

    Args:
        store: the map.
        files: the images.
        settings: `weights` and `max_pixels` are used.
        jobs: local processes; 1: this one.
        progress: is told how it proceeds.
    """
    known = {image.name: image for image in store.images()}
    named = {name_of(file, store.folder): file for file in files}
    tasks = []
    for name, file in named.items():
        sha256 = content_hash(file)
        old = known.get(name)
        if old is None or not old.usable or old.sha256 != sha256:
            tasks.append(_Task(file, name, sha256, store.manifest.max_size, settings))
    done = len(named) - len(tasks)
    progress(done, len(named))
    described: list[MapImage] = []
    waiting: list[Indexed] = []
    for entry in Workers(jobs).run(_indexed, tasks, _died):
        waiting.append(entry)
        described.append(entry.image)
        if sum(each.image.landmarks for each in waiting) >= LANDMARKS_PER_COMMIT:
            store.add(waiting)
            waiting = []
        done += 1
        progress(done, len(named))
    store.add(waiting)
    usable = [image for image in described if image.usable]
    replaced = sum(image.name in known for image in usable)
    failed = sorted((each.name, each.status) for each in described if not each.usable)
    return Added(len(usable) - replaced, replaced, len(named) - len(tasks), tuple(failed))


def _indexed(task: _Task) -> Indexed:
    """What a map holds of an image; for one that cannot be read only the reason."""
    try:
        return _described(task)
    except ImageError as error:
        return _failed(task, str(error).replace(str(task.file), "the file"))


def _described(task: _Task) -> Indexed:
    """What a map holds of an image.

    Raises:
        ImageError: it cannot be read.
    """
    photograph = open_image(task.file, task.settings.max_pixels)
    describer = _describer(task.settings)
    tiles, parts = [], []
    for level, members in enumerate(levels(photograph.width, photograph.height, task.max_size)):
        for tile, core in members:
            pixels = photograph.read(tile)
            scales = whole_scales(tile.columns, tile.rows) if level == 0 else finer_scales()
            parts.append(_in_original(describer.of_map(pixels, scales), tile, core))
            tiles.append((tile, packed_keypoints(pixels)))
    landmarks = Landmarks.joined(parts)
    image = _image(task, photograph.width, photograph.height, OK, len(landmarks))
    return Indexed(image, tiles, landmarks)


def _in_original(landmarks: Landmarks, tile: Tile, core: Core) -> Landmarks:
    """The landmarks in the core of a tile, in pixels of the original image."""
    centre = transform(tile.original_from_tile, landmarks.centre)
    low, high = [core.left, core.top], [core.right, core.bottom]
    own = np.all((centre >= low) & (centre < high), axis=1)
    side = landmarks.side / tile.scale
    return Landmarks(centre, side, landmarks.angle, landmarks.vectors)[own]


def _died(task: _Task) -> Indexed:
    return _failed(task, "the process that described it died")


def _failed(task: _Task, reason: str) -> Indexed:
    return Indexed(_image(task, 0, 0, reason, 0), [], Landmarks.joined([]))


def _image(task: _Task, width: int, height: int, status: str, landmarks: int) -> MapImage:
    digest = hashlib.sha256(f"{task.name}\0{task.sha256}".encode()).digest()
    number = int(np.frombuffer(digest[:8], "<u8")[0] >> 1)
    return MapImage(number, task.name, task.sha256, width, height, status, landmarks)


@functools.lru_cache(maxsize=1)
def _describer(settings: Settings) -> LandmarkDescriber:
    """One a process."""
    return LandmarkDescriber(settings)
