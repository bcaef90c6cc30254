"""What the tables of a map hold; needs no database."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.maps.landmarks import Landmarks
from nearfar.maps.sources import Tile

OK = "ok"
"""Status of an image that could be read."""


@dataclass(frozen=True)
class MapImage:
    """An image of a map.

    Attributes:
        id: number by which tiles and landmarks name it; it tells name and content.
        name: path of its file, relative to the folder that holds the map.
        sha256: of the file's content; empty where that could not be read.
        width: as displayed, in pixels; 0 where it could not be read.
        height: the same.
        status: "ok", or why it could not be read.
        landmarks: how many it has.
        size: of the file, in bytes; -1 where it has to be looked at again.
        modified: time of the file's last change, in nanoseconds since 1970; -1 likewise.
    """

    id: int
    name: str
    sha256: str
    width: int
    height: int
    status: str
    landmarks: int
    size: int = -1
    modified: int = -1

    @property
    def usable(self) -> bool:
        """Whether it could be read."""
        return self.status == OK


@dataclass(frozen=True, eq=False)
class Indexed:
    """All that a map holds of one image.

    Attributes:
        image: its row.
        tiles: each tile with its packed keypoints.
        landmarks: in pixels of the original image.
    """

    image: MapImage
    tiles: list[tuple[Tile, bytes]]
    landmarks: Landmarks


@dataclass(frozen=True, eq=False)
class Block:
    """Some landmarks of a map.

    Attributes:
        image: (N,) ids of their images.
        place: (N, 3) x and y of the centre, and side, in pixels of the original image.
        vectors: (N, 256).
    """

    image: NDArray[np.int64]
    place: NDArray[np.float32]
    vectors: NDArray[np.float16]


@dataclass(frozen=True, eq=False)
class Likeness:
    """What an index finds, in any order.

    Attributes:
        query: (N,) number of the query landmark.
        image: (N,) id of the image of the map landmark.
        place: (N, 3) as in `Block`.
        similarity: (N,) cosine.
    """

    query: NDArray[np.intp]
    image: NDArray[np.int64]
    place: NDArray[np.float32]
    similarity: NDArray[np.float32]
