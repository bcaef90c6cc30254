"""Describe the images of a map: only those that are new or have changed."""

import functools
import hashlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nearfar.errors import ImageError, NearfarError
from nearfar.geometry.homography import transform
from nearfar.imaging.tiles import Core, Tile
from nearfar.maps.files import content_hash, has_state, name_of, readable_hash, state_of
from nearfar.maps.images import copied, is_irregular, levels, open_image
from nearfar.maps.landmarks import (
    LandmarkDescriber,
    Landmarks,
    finer_scales,
    unmasked,
    whole_scales,
)
from nearfar.maps.masks import MaskStore, mask_hash, stored_mask
from nearfar.maps.store import MapStore
from nearfar.maps.tables import OK, Indexed, MapImage, StoredMask, packed_keypoints
from nearfar.maps.world.photo_position import PhotoPosition, position_of
from nearfar.maps.world.positions import PositionStore
from nearfar.runtime.logs import Progress
from nearfar.runtime.timing import Meter, RunMetrics
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.locations import Location, is_text

LANDMARKS_PER_COMMIT = 50_000
"""Number of landmarks from which on the waiting images are committed; a crash loses fewer."""
IMAGES_PER_COMMIT = 5_000
"""Number of waiting images from which on they are committed, where few of them have landmarks."""


@dataclass(frozen=True)
class Added:
    """Counts of what adding images did.

    Attributes:
        added: images that are new.
        replaced: images whose content had changed, or that could not be read before.
        unchanged: images that were there already.
        failed: name and reason of each image that could not be read, whose name is not UTF-8, or
            that is no regular file. What the map had of an unreadable file is kept.
        metrics: time, workers and counts of the run.
    """

    added: int
    replaced: int
    unchanged: int
    failed: tuple[tuple[str, str], ...]
    metrics: RunMetrics


@dataclass(frozen=True)
class _Task:
    """An image to describe.

    Attributes:
        file: file of the image.
        name: name of the image in the map.
        known: the usable image of this name in the map; None where there is none.
        max_size: see `Manifest`.
        bands: see `Manifest`.
        settings: `weights` and `max_pixels` are used.
        mask: file of its mask; None for none.
    """

    file: Location
    name: str
    known: MapImage | None
    max_size: int
    bands: str
    settings: Settings
    mask: Path | None = None


def add_images(
    store: MapStore,
    files: Iterable[Location],
    settings: Settings,
    workers: Workers,
    progress: Progress,
    masks: Mapping[Location, Path] | None = None,
) -> Added:
    """Add files to a map; must be called within `MapStore.writing`.

    Images are committed in the order of the files, so that a map does not depend on the workers.
    Workers read the files and return what they find; this process alone writes.

    Args:
        store: the map.
        files: the images.
        settings: `weights` and `max_pixels` are used.
        workers: processes that describe the images.
        progress: is called with the number of images done and of all images.
        masks: file of the mask of each image that has one; None leaves the images that the map has
            with the masks that they have.

    Raises:
        StorageError: object storage does not answer; images that were committed are kept.
    """
    meter = Meter()
    known = {image.name: image for image in store.images()}
    named = {name_of(file, store.folder): file for file in files}
    left_out = _left_out(named)
    mask_store, positions = MaskStore(store.folder), PositionStore(store.folder)
    tasks = _changed(
        named, known, store, settings, masks, mask_store.hashes(), positions.all().keys()
    )
    meter.skipped = len(named) - len(tasks)
    progress(meter.skipped, len(named))
    described: list[MapImage] = []
    same = 0
    waiting = _Waiting(store, mask_store, positions)
    kept: list[_Kept] = []
    for found in workers.run_in_order(_indexed, tasks, _died, meter):
        if isinstance(found, _Kept):
            kept.append(found)
            meter.failed += 1
        else:
            waiting.take(found)
        if isinstance(found, _Described):
            described.append(found.image)
            meter.failed += not found.image.usable
        same += isinstance(found, _Same)
        progress(meter.skipped + meter.done, len(named))
    waiting.commit()
    ids = [image.id for image in store.images()]
    mask_store.keep(ids)
    positions.keep(ids)
    usable_images = [image for image in described if image.usable]
    replaced = sum(image.name in known for image in usable_images)
    failed = [(each.name, each.status) for each in described if not each.usable]
    failed += [(each.name, each.reason) for each in kept]
    failed += left_out.items()
    return Added(
        len(usable_images) - replaced,
        replaced,
        meter.skipped + same,
        tuple(sorted(failed)),
        meter.metrics(),
    )


def _changed(
    named: dict[str, Location],
    known: dict[str, MapImage],
    store: MapStore,
    settings: Settings,
    masks: Mapping[Location, Path] | None,
    hashes: Mapping[int, str],
    placed: Collection[int],
) -> list[_Task]:
    """Return the images to describe: new ones, and those whose file or mask has changed.

    Images whose metadata were not read, by an older version, are among them.
    """
    made, tasks = store.manifest, []
    for name, file in named.items():
        old = known.get(name)
        usable = old if old is not None and old.usable else None
        mask = None if masks is None else masks.get(file)
        if usable is not None and masks is not None:
            usable = usable if _same_mask(mask, hashes.get(usable.id)) else None
        same = usable is not None and usable.id in placed and has_state(usable, state_of(file))
        if not same:
            tasks.append(_Task(file, name, usable, made.max_size, made.bands, settings, mask))
    return tasks


def _same_mask(mask: Path | None, known: str | None) -> bool:
    """Return whether a mask is the one that the map has; one that cannot be read is another."""
    try:
        return known == (None if mask is None else mask_hash(mask))
    except ImageError:
        return False


def _left_out(named: dict[str, Location]) -> dict[str, str]:
    """Remove the files that are left out without being opened; return the reason of each."""
    reasons = {name: _unfit(name, file) for name, file in named.items()}
    found = {name: reason for name, reason in reasons.items() if reason is not None}
    for name in found:
        del named[name]
    return found


def _unfit(name: str, file: Location) -> str | None:
    """Return why a file is left out without being opened; None for one that may be an image."""
    if not is_text(name):
        return "its name is not UTF-8: rename it"
    return "it is not a regular file" if is_irregular(file) else None


class _Waiting:
    """Collects images and commits them together."""

    def __init__(self, store: MapStore, masks: MaskStore, positions: PositionStore) -> None:
        self._store, self._masks, self._positions = store, masks, positions
        self._entries: list[Indexed] = []
        self._same: list[MapImage] = []
        self._places: dict[int, PhotoPosition] = {}
        self._landmarks = 0

    def take(self, found: "_Described | _Same") -> None:
        """Add an image, and commit all that are waiting if they are enough."""
        if found.position is not None:
            self._places[found.image.id] = found.position
        if isinstance(found, _Same):
            self._same.append(found.image)
        else:
            self._entries.append(found.entry)
            self._landmarks += found.image.landmarks
        images = len(self._entries) + len(self._same)
        if self._landmarks >= LANDMARKS_PER_COMMIT or images >= IMAGES_PER_COMMIT:
            self.commit()

    def commit(self) -> None:
        self._masks.put(
            {each.image.id: each.mask for each in self._entries if each.mask is not None}
        )
        self._positions.put(self._places)
        self._store.add(self._entries)
        self._store.put_images(self._same)
        self._entries, self._same, self._places, self._landmarks = [], [], {}, 0


@dataclass(frozen=True, eq=False)
class _Described:
    """An image that was described, or that cannot be.

    Attributes:
        entry: what the map holds of it.
        position: where it was taken; None for an image that cannot be read.
    """

    entry: Indexed
    position: PhotoPosition | None = None

    @property
    def image(self) -> MapImage:
        """The row of the image."""
        return self.entry.image


@dataclass(frozen=True)
class _Same:
    """An image that the map has with the same content.

    Attributes:
        image: its row, with the new state of its file.
        position: where it was taken.
    """

    image: MapImage
    position: PhotoPosition


@dataclass(frozen=True)
class _Kept:
    """An image of the map whose file could not be read this time; the map keeps what it has.

    Attributes:
        name: name of the image.
        reason: why its file could not be read.
    """

    name: str
    reason: str


def _indexed(task: _Task) -> _Described | _Same | _Kept:
    """Describe an image; return only its row where the map has the image with the same content.

    An image that cannot be described gets the reason as its status, so that it fails alone. Where
    its file cannot even be read, the map keeps what it has of the image.

    Raises:
        NearfarError: something else than the image is at fault.
    """
    state = state_of(task.file)
    sha256 = ""
    try:
        sha256 = readable_hash(task.file)
        if task.known is not None and task.known.sha256 == sha256:
            known = replace(task.known, size=state.size, modified=state.modified)
            return _Same(known, position_of(copied(task.file), known.width, known.height))
        found = _described(task, sha256)
        width, height = found.image.width, found.image.height
        position = position_of(copied(task.file), width, height)
    except ImageError as error:
        reason = str(error).replace(str(task.file), "the file")
        if task.known is not None and not (sha256 and content_hash(task.file)):
            return _Kept(task.name, reason)
        return _failed(task, sha256, reason)
    except NearfarError:
        raise
    except Exception as error:  # Libraries raise many kinds of errors for an image.
        return _failed(task, sha256, f"{type(error).__name__}: {error}")
    image = replace(found.image, size=state.size, modified=state.modified)
    return _Described(replace(found, image=image), position)


def _described(task: _Task, sha256: str) -> Indexed:
    """Return the row, the tiles and the landmarks of an image.

    Raises:
        ImageError: the image cannot be read.
    """
    photograph = open_image(task.file, task.settings.max_pixels, task.mask, task.bands)
    size = photograph.width, photograph.height
    mask = None if task.mask is None else stored_mask(task.mask, size)
    describer = _describer(task.settings)
    tiles, parts = [], []
    for level, members in enumerate(levels(photograph.width, photograph.height, task.max_size)):
        for tile, core in members:
            pixels = photograph.read(tile)
            scales = whole_scales(tile.columns, tile.rows) if level == 0 else finer_scales()
            used = photograph.mask(tile)
            found = unmasked(describer.of_map(pixels, scales), used)
            parts.append(_in_original(found, tile, core))
            tiles.append((tile, packed_keypoints(pixels, used)))
    landmarks = Landmarks.joined(parts)
    image = _image(task, sha256, size, OK, len(landmarks), mask)
    return Indexed(image, tiles, landmarks, mask)


def _in_original(landmarks: Landmarks, tile: Tile, core: Core) -> Landmarks:
    """Return the landmarks in the core of a tile, in pixels of the original image."""
    centre = transform(tile.original_from_tile, landmarks.centre)
    low, high = [core.left, core.top], [core.right, core.bottom]
    own = np.all((centre >= low) & (centre < high), axis=1)
    side = landmarks.side / tile.scale
    return Landmarks(centre, side, landmarks.angle, landmarks.vectors)[own]


def _died(task: _Task) -> _Described:
    return _failed(task, "", "the process that described it died")


def _failed(task: _Task, sha256: str, reason: str) -> _Described:
    return _Described(Indexed(_image(task, sha256, (0, 0), reason, 0), [], Landmarks.joined([])))


def _image(
    task: _Task,
    sha256: str,
    size: tuple[int, int],
    status: str,
    landmarks: int,
    mask: StoredMask | None = None,
) -> MapImage:
    """Return the row of an image; its id depends on the mask, as its landmarks do."""
    content = f"{task.name}\0{sha256}" + ("" if mask is None else f"\0{mask.sha256}")
    digest = hashlib.sha256(content.encode()).digest()
    number = int(np.frombuffer(digest[:8], "<u8")[0] >> 1)
    return MapImage(number, task.name, sha256, *size, status, landmarks)


@functools.lru_cache(maxsize=1)
def _describer(settings: Settings) -> LandmarkDescriber:
    """Return the describer of this process."""
    return LandmarkDescriber(settings)
