"""The columns of the tables of a map, and what their rows hold."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.features.detection import detect, root_sift, sift
from nearfar.features.keypoints import Keypoints
from nearfar.imaging.mask import PixelMask, usable
from nearfar.imaging.tiles import Tile
from nearfar.maps.database import connect
from nearfar.maps.landmarks import DIMENSIONS, Landmarks
from nearfar.storage.locations import Location

OK = "ok"
"""Status of an image that could be read."""


@dataclass(frozen=True)
class MapImage:
    """An image of a map.

    Attributes:
        id: number by which tiles and landmarks refer to the image, a hash of name and content.
        name: path of the file relative to the folder that holds the map.
        sha256: SHA-256 of the file; empty where it could not be read.
        width: as displayed, in pixels; 0 where the image could not be read.
        height: as displayed, in pixels; 0 where the image could not be read.
        status: "ok", or why the image could not be read.
        landmarks: number of its landmarks.
        size: size of the file in bytes; -1 where the next build has to read the file again.
        modified: time of the file's last change, in nanoseconds since 1970; -1 as for `size`.
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
        """Whether the image could be read."""
        return self.status == OK


@dataclass(frozen=True, eq=False)
class StoredMask:
    """The mask of a map image.

    Attributes:
        sha256: of the file that it was read from.
        png: (height, width) of the original image as PNG, 0 where it is left out.
    """

    sha256: str
    png: bytes

    def pixels(self) -> PixelMask:
        """Return the mask, True where pixels may be used."""
        values = cv2.imdecode(np.frombuffer(self.png, np.uint8), cv2.IMREAD_GRAYSCALE)
        return np.asarray(values != 0)


@dataclass(frozen=True, eq=False)
class Indexed:
    """All that a map holds of one image.

    Attributes:
        image: row of the image.
        tiles: each tile with its packed keypoints.
        landmarks: landmarks in pixels of the original image.
        mask: mask that was given with the image; None for none.
    """

    image: MapImage
    tiles: list[tuple[Tile, bytes]]
    landmarks: Landmarks
    mask: StoredMask | None = None


@dataclass(frozen=True, eq=False)
class Block:
    """Some landmarks of a map.

    Attributes:
        image: (N,) ids of the images that show the landmarks.
        place: (N, 3) x and y of the centre, and side, in pixels of the original image.
        vectors: (N, 256) descriptors of unit length.
    """

    image: NDArray[np.int64]
    place: NDArray[np.float32]
    vectors: NDArray[np.float16]


@dataclass(frozen=True, eq=False)
class IndexHits:
    """Nearest neighbours that an index finds, in any order.

    Attributes:
        query: (N,) numbers of the query landmarks.
        image: (N,) ids of the images of the map landmarks.
        place: (N, 3) centres and sides as in `Block`.
        similarity: (N,) cosine similarities.
    """

    query: NDArray[np.intp]
    image: NDArray[np.int64]
    place: NDArray[np.float32]
    similarity: NDArray[np.float32]


def schema_of(**columns: pa.DataType) -> pa.Schema:
    """Return a schema of columns without nulls."""
    return pa.schema([pa.field(name, kind, nullable=False) for name, kind in columns.items()])


IMAGES = schema_of(
    id=pa.int64(),
    name=pa.string(),
    sha256=pa.string(),
    width=pa.int32(),
    height=pa.int32(),
    status=pa.string(),
    landmarks=pa.int32(),
    size=pa.int64(),
    modified=pa.int64(),
)
WINDOW = ("left", "top", "width", "height", "columns", "rows")
TILES = schema_of(
    image=pa.int64(), **dict.fromkeys(WINDOW, pa.int32()), keypoints=pa.large_binary()
)
LANDMARKS = schema_of(
    image=pa.int64(),
    x=pa.float32(),
    y=pa.float32(),
    side=pa.float32(),
    vector=pa.list_(pa.float16(), DIMENSIONS),
)
SCHEMAS = {"images": IMAGES, "tiles": TILES, "landmarks": LANDMARKS}


def make_tables(folder: Location) -> None:
    """Make all tables, without rows."""
    database = connect(folder)
    for name, schema in SCHEMAS.items():
        database.create_table(name, schema=schema)


def owners(table: Any) -> set[int]:
    """Return the ids of the images that the rows of a table belong to."""
    ids: set[int] = set()
    for batch in table.search().select(["image"]).to_batches():
        ids.update(np.unique(batch["image"].to_numpy()).tolist())
    return ids


def block_of(rows: pa.RecordBatch | pa.Table) -> Block:
    """Return the landmarks of rows that have all columns."""
    place = np.column_stack([rows[name].to_numpy() for name in ("x", "y", "side")])
    vectors = pc.list_flatten(rows["vector"]).to_numpy().reshape(-1, DIMENSIONS)
    return Block(rows["image"].to_numpy(), place, vectors)


def landmark_rows(entry: Indexed) -> pa.Table:
    """Return the rows of an image's landmarks."""
    own = entry.landmarks
    vectors = pa.array(own.vectors.ravel())
    columns: list[Any] = [
        np.full(len(own), entry.image.id),
        *own.centre.T.astype(np.float32),
        own.side.astype(np.float32),
        pa.FixedSizeListArray.from_arrays(vectors, DIMENSIONS),
    ]
    return table_of(columns, LANDMARKS)


def tile_rows(entries: Sequence[Indexed]) -> pa.Table:
    """Return the rows of the tiles of images."""
    rows = [
        (entry.image.id, *(getattr(tile, name) for name in WINDOW), keypoints)
        for entry in entries
        for tile, keypoints in entry.tiles
    ]
    columns = zip(*rows, strict=True) if rows else [[]] * len(TILES)
    return table_of([list(column) for column in columns], TILES)


def table_of(columns: Sequence[Any], schema: pa.Schema) -> pa.Table:
    """Return a table of columns in the order of a schema."""
    arrays = [
        column if isinstance(column, pa.Array) else pa.array(column, field.type)
        for column, field in zip(columns, schema, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


MOST = 4000
"""Largest number of keypoints of a tile that are kept, those of the highest contrast."""

_RECORD = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("size", "<f4"), ("angle", "<f4"), ("vector", "u1", 128)]
)
"""SIFT's own values without loss, 144 bytes: diameter in pixels, angle in degrees."""


def packed_keypoints(pixels: RGBPixels, mask: PixelMask | None = None) -> bytes:
    """Detect the keypoints of the method `adaptive`, at most `MOST`, and pack them.

    Args:
        pixels: the image.
        mask: (height, width) True where keypoints may lie; None: everywhere.
    """
    found = detect(pixels, sift(DEFAULT.points.contrast, MOST))
    if mask is not None:
        found = found[usable(mask, pixels.shape[1::-1], found.xy)]
    records = np.empty(len(found), _RECORD)
    records["x"], records["y"] = found.xy.T
    records["size"], records["angle"] = found.scale, np.degrees(found.angle)
    records["vector"] = found.descriptors
    return records.tobytes()


def unpacked_keypoints(blob: bytes) -> Keypoints:
    """Return the keypoints of `packed_keypoints`, described by RootSIFT; their scores are 0."""
    records = np.frombuffer(blob, _RECORD)
    x, y, size, angle = (records[name].astype(np.float64) for name in ("x", "y", "size", "angle"))
    return root_sift(
        Keypoints.of(
            np.column_stack([x, y]), records["vector"], scale=size, angle=np.radians(angle)
        )
    )
