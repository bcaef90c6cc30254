"""Masks of the images of a map: the table that holds them, and the files that they come from."""

import hashlib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa

from nearfar.errors import ImageError
from nearfar.imaging.mask import read_mask
from nearfar.imaging.mask_folder import MaskFolder
from nearfar.maps.database import own_errors
from nearfar.maps.images import ImageFiles, named_files
from nearfar.maps.side_table import SideTable
from nearfar.maps.tables import StoredMask, schema_of
from nearfar.storage.locations import Location


def stored_mask(file: Path, size: tuple[int, int]) -> StoredMask:
    """Read the mask of an image.

    Args:
        file: the mask.
        size: width and height of the image as displayed, in pixels.

    Raises:
        ImageError: it cannot be read, or has another size than the image.
    """
    mask = read_mask(file, size)
    _, png = cv2.imencode(".png", mask.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    return StoredMask(mask_hash(file), png.tobytes())


def mask_hash(file: Path) -> str:
    """Return the SHA-256 of a mask's file.

    Raises:
        ImageError: it cannot be read.
    """
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ImageError(f"the mask {file} cannot be read: {error.strerror}") from error


def mask_files(images: ImageFiles, masks: str | PathLike[str]) -> dict[Location, Path]:
    """Return the masks of those images that have one, by the file of the image.

    Args:
        images: as they are given to `Map.add`. An image of a folder has the mask at its path in
            that folder; one that is given by itself has the mask of its name.
        masks: folder of the masks.

    Raises:
        ImageError: there is no such folder.
        MapError: there is no such image.
    """
    folder = MaskFolder.opened(masks)
    found = ((file, folder.mask_of(name)) for file, name in named_files(images).items())
    return {file: mask for file, mask in found if mask is not None}


class MaskStore(SideTable):
    """The masks of the images of a map, by the image's id.

    Args:
        folder: folder of a map that exists.
    """

    NAME = "masks"
    SCHEMA = schema_of(image=pa.int64(), sha256=pa.string(), mask=pa.large_binary())

    @own_errors
    def get(self, image: int) -> StoredMask | None:
        """Return the mask of an image; None where it has none."""
        table = self._table()
        if table is None:
            return None
        rows = table.search().where(f"image = {image}").limit(1).to_list()
        return StoredMask(rows[0]["sha256"], rows[0]["mask"]) if rows else None

    @own_errors
    def hashes(self) -> dict[int, str]:
        """Return the SHA-256 of each mask's file."""
        table = self._table()
        if table is None:
            return {}
        rows = table.search().select(["image", "sha256"]).to_list()
        return {row["image"]: row["sha256"] for row in rows}

    @own_errors
    def put(self, masks: Mapping[int, StoredMask]) -> None:
        """Add masks, or replace those of the same images; within `MapStore.writing`."""
        self._put(
            [
                {"image": image, "sha256": each.sha256, "mask": each.png}
                for image, each in masks.items()
            ]
        )
