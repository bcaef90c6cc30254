"""Whether a map is sound and its image files are still there."""

from dataclasses import dataclass

import numpy as np

from nearfar.maps.files import content_hash, file_of
from nearfar.maps.store import MapStore


@dataclass(frozen=True)
class Problem:
    """Something that is wrong with a map.

    Attributes:
        image: name of the image; None where it is the map as a whole.
        what: in words.
    """

    image: str | None
    what: str


def problems(store: MapStore) -> list[Problem]:
    """All problems of a map, by image."""
    counts: dict[int, int] = {}
    for block in store.blocks():
        for image, count in zip(*np.unique(block.image, return_counts=True), strict=True):
            counts[int(image)] = counts.get(int(image), 0) + int(count)
    found = []
    for image in store.images():
        file = file_of(image.name, store.folder)
        if not file.is_file():
            found.append(Problem(image.name, "the file is missing"))
        elif not image.usable:
            found.append(Problem(image.name, image.status))
        elif content_hash(file) != image.sha256:
            found.append(Problem(image.name, "the file has changed: build the map again"))
        if image.usable and not store.tiles(image.id):
            found.append(Problem(image.name, "its tiles are missing: remove and add it"))
        if counts.get(image.id, 0) != image.landmarks:
            found.append(Problem(image.name, "landmarks are missing: remove and add it"))
    left = store.orphans()
    if left:
        what = (
            f"parts of {len(left)} images that were never completed; the next change removes them"
        )
        found.append(Problem(None, what))
    return found
