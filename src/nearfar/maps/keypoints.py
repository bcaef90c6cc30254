"""The keypoints of a tile as bytes, so that locating in it does not detect them again."""

import numpy as np

from nearfar.adaptive.keypoints import Keypoints, rooted
from nearfar.arrays import RGBPixels
from nearfar.methods.adaptive import CONTRAST
from nearfar.points import keypoints_of, sift

MOST = 4000
"""Keypoints that are kept of a tile, those of the highest contrast."""

_RECORD = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("size", "<f4"), ("angle", "<f4"), ("vector", "u1", 128)]
)
"""SIFT's own values, which are lossless so; 144 bytes."""


def packed_keypoints(pixels: RGBPixels) -> bytes:
    """The keypoints of an image that the method `adaptive` would find, at most `MOST`."""
    table, vectors = keypoints_of(pixels, sift(CONTRAST, MOST))
    records = np.empty(len(table), _RECORD)
    for column, name in enumerate(("x", "y", "size", "angle")):
        records[name] = table[:, column]
    records["vector"] = vectors
    return records.tobytes()


def unpacked_keypoints(blob: bytes) -> Keypoints:
    """The keypoints of `packed_keypoints`."""
    records = np.frombuffer(blob, _RECORD)
    columns = [records[name].astype(np.float64) for name in ("x", "y", "size", "angle")]
    return rooted(np.column_stack(columns), records["vector"].astype(np.float32))
