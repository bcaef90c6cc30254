"""Whether a map is sound and its image files are still there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from nearfar.maps.entries import MapImage
from nearfar.maps.files import content_hash, file_of, is_unchanged
from nearfar.maps.store import MapStore
from nearfar.maps.world.views import View, ViewStore


@dataclass(frozen=True)
class Problem:
    """Something that is wrong with a map.

    Attributes:
        image: name of the image; None where it is the map as a whole.
        what: in words.
    """

    image: str | None
    what: str


ROTATION_ERROR = 1e-3
"""Largest difference of a rotation times its transpose from the identity."""
VIEWS_AT_ONCE = 500
"""That are held in memory."""


def problems(store: MapStore, *, content: bool = False) -> list[Problem]:
    """All problems of a map, by image.

    Args:
        store: the map.
        content: read also the files whose size and time are those that were recorded.

    Raises:
        StorageError: the map or an image is in object storage that does not answer.
    """
    counts: dict[int, int] = {}
    for block in store.blocks():
        for image, count in zip(*np.unique(block.image, return_counts=True), strict=True):
            counts[int(image)] = counts.get(int(image), 0) + int(count)
    images, tiled = store.images(), store.tiled()
    found = []
    for image in images:
        found += [Problem(image.name, what) for what in _of_file(image, store, content=content)]
        if image.usable and image.id not in tiled:
            found.append(Problem(image.name, "its tiles are missing: remove and add it"))
        if counts.get(image.id, 0) != image.landmarks:
            found.append(Problem(image.name, "landmarks are missing: remove and add it"))
    found += _of_poses(ViewStore(store.folder), images)
    left = store.orphans()
    if left:
        what = (
            f"parts of {len(left)} images that were never completed; the next change removes them"
        )
        found.append(Problem(None, what))
    return found


def _of_file(image: MapImage, store: MapStore, *, content: bool) -> Iterator[str]:
    """What is wrong with the file of an image."""
    file = file_of(image.name, store.folder)
    if not file.is_file():
        yield "the file is missing"
    elif not image.usable:
        yield image.status
    elif not is_unchanged(file, image) or (content and content_hash(file) != image.sha256):
        yield "the file has changed: build the map again"


def _of_poses(store: ViewStore, images: Sequence[MapImage]) -> Iterator[Problem]:
    """What is wrong with the poses of images."""
    names = {image.id: image.name for image in images}
    posed = store.ids()
    old = len(posed - names.keys())
    if old:
        what = f"{old} poses are of images that were removed or replaced: add their poses again"
        yield Problem(None, what)
    known = sorted(posed & names.keys(), key=names.__getitem__)
    for start in range(0, len(known), VIEWS_AT_ONCE):
        for number, view in store.get(known[start : start + VIEWS_AT_ONCE]).items():
            if not _is_sound(view):
                yield Problem(names[number], "its pose is damaged: add it again")


def _is_sound(view: View) -> bool:
    """Whether camera and pose are finite and the rotation is one."""
    camera = view.camera
    numbers = [camera.fx, camera.fy, camera.cx, camera.cy, *view.centre, *view.rotation.ravel()]
    if not np.isfinite(numbers).all() or len(view.observed) != len(view.points):
        return False
    error = np.abs(view.rotation @ view.rotation.T - np.eye(3)).max()
    return bool(error < ROTATION_ERROR and np.linalg.det(view.rotation) > 0)
