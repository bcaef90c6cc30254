"""The tables of a map: their columns, and rows of them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nearfar.maps.database import connect
from nearfar.maps.entries import Block, Indexed
from nearfar.maps.landmarks import DIMENSIONS
from nearfar.storage import Location

IMAGES = pa.schema(
    [
        pa.field("id", pa.int64(), nullable=False),
        pa.field("name", pa.string(), nullable=False),
        pa.field("sha256", pa.string(), nullable=False),
        pa.field("width", pa.int32(), nullable=False),
        pa.field("height", pa.int32(), nullable=False),
        pa.field("status", pa.string(), nullable=False),
        pa.field("landmarks", pa.int32(), nullable=False),
        pa.field("size", pa.int64(), nullable=False),
        pa.field("modified", pa.int64(), nullable=False),
    ]
)
WINDOW = ("left", "top", "width", "height", "columns", "rows")
TILES = pa.schema(
    [
        pa.field("image", pa.int64(), nullable=False),
        *(pa.field(name, pa.int32(), nullable=False) for name in WINDOW),
        pa.field("keypoints", pa.large_binary(), nullable=False),
    ]
)
LANDMARKS = pa.schema(
    [
        pa.field("image", pa.int64(), nullable=False),
        pa.field("x", pa.float32(), nullable=False),
        pa.field("y", pa.float32(), nullable=False),
        pa.field("side", pa.float32(), nullable=False),
        pa.field("vector", pa.list_(pa.float16(), DIMENSIONS), nullable=False),
    ]
)
SCHEMAS = {"images": IMAGES, "tiles": TILES, "landmarks": LANDMARKS}


def make_tables(folder: Location) -> None:
    """Make all tables, without rows."""
    database = connect(folder)
    for name, schema in SCHEMAS.items():
        database.create_table(name, schema=schema)


def owners(table: Any) -> set[int]:
    """The ids of images that the rows of a table are of."""
    ids: set[int] = set()
    for batch in table.search().select(["image"]).to_batches():
        ids.update(np.unique(batch["image"].to_numpy()).tolist())
    return ids


def block_of(rows: pa.RecordBatch | pa.Table) -> Block:
    """Landmarks of rows that have all columns."""
    place = np.column_stack([rows[name].to_numpy() for name in ("x", "y", "side")])
    vectors = pc.list_flatten(rows["vector"]).to_numpy().reshape(-1, DIMENSIONS)
    return Block(rows["image"].to_numpy(), place, vectors)


def landmark_rows(entry: Indexed) -> pa.Table:
    """The landmarks of an image."""
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
    """The tiles of images."""
    rows = [
        (entry.image.id, *(getattr(tile, name) for name in WINDOW), keypoints)
        for entry in entries
        for tile, keypoints in entry.tiles
    ]
    columns = zip(*rows, strict=True) if rows else [[]] * len(TILES)
    return table_of([list(column) for column in columns], TILES)


def table_of(columns: Sequence[Any], schema: pa.Schema) -> pa.Table:
    """A table of columns in the order of a schema."""
    arrays = [
        column if isinstance(column, pa.Array) else pa.array(column, field.type)
        for column, field in zip(columns, schema, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=schema)
