"""The store of a map, on disk or in object storage: tables of images, tiles and landmarks.

LanceDB commits each change to a table as a whole. Tiles and landmarks of an image are committed
before its row in `images`. Without that row they do not count, and the next writer removes them,
so a process may be killed at any time. A reader sees the map as it was when it was opened.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta

import numpy as np
import pyarrow as pa
from lancedb.index import IvfRq
from numpy.typing import NDArray

from nearfar.errors import MapError
from nearfar.imaging.tiles import Tile
from nearfar.maps.database import connect, database_errors, open_table, own_errors, writer_lock
from nearfar.maps.manifest import read_manifest
from nearfar.maps.tables import (
    IMAGES,
    SCHEMAS,
    WINDOW,
    Block,
    Indexed,
    IndexHits,
    MapImage,
    block_of,
    landmark_rows,
    owners,
    table_of,
    tile_rows,
)
from nearfar.storage.locations import Location

INDEX_FROM = 200_000
"""Number of landmarks without an index from which on one is built; below it, comparing with all
landmarks is faster."""
KEPT = timedelta(hours=1)
"""Time for which files are kept that only readers of an older state of the map need."""
PROBES, LANDMARKS_PER_PROBE = 20, 50_000
"""Least number of partitions of the index to probe, and landmarks of the map per partition."""
COMPARED = 160
"""Number of landmarks that the index finds for each descriptor, to be compared exactly. Of the ten
nearest among 4.6 million, 96 % are found; with 80 it is 92 %, in 0.7 of the time."""
READ_AT_ONCE = 4096
"""Number of landmarks that are read together."""


class MapStore:
    """The tables of a map that exists.

    Every method raises `MapError` where the tables cannot be read or written, e.g. on a full disk,
    and `StorageError` where object storage does not answer.

    Args:
        folder: folder of the map.

    Raises:
        MapError: there is no map, or it has another format.
    """

    def __init__(self, folder: Location) -> None:
        self.folder = folder
        self.manifest = read_manifest(folder)
        with database_errors(folder):
            database = connect(folder)
            # Opened in this order, so that the parts of an image are there before its row.
            tables = [open_table(database, name, folder) for name in SCHEMAS]
        if any(table is None for table in tables):
            raise MapError(f"the map {folder} lacks tables: build it anew")
        self._images, self._tiles, self._landmarks = tables

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Be the only writer; first remove what a writer that was killed left behind.

        Raises:
            MapError: another process is writing.
        """
        with writer_lock(self.folder):
            with database_errors(self.folder):
                for table in (self._images, self._tiles, self._landmarks):
                    table.checkout_latest()
                self._remove_orphans()
            yield

    @own_errors
    def images(self) -> list[MapImage]:
        """Return all images, also those that could not be read, sorted by name."""
        rows = self._images.search().to_list()
        names = [field.name for field in IMAGES]
        found = [MapImage(**{name: row[name] for name in names}) for row in rows]
        return sorted(found, key=lambda each: each.name)

    @own_errors
    def tiles(self, image: int) -> list[Tile]:
        """Return the tiles of an image."""
        rows = self._tiles.search().where(f"image = {image}").select(list(WINDOW)).to_list()
        return [Tile(*(row[name] for name in WINDOW)) for row in rows]

    @own_errors
    def keypoints(self, image: int, tile: Tile) -> bytes | None:
        """Return the packed keypoints of a tile; None where there is no such tile."""
        same = [f"{name} = {getattr(tile, name)}" for name in WINDOW]
        condition = " AND ".join([f"image = {image}", *same])
        rows = self._tiles.search().where(condition).select(["keypoints"]).limit(1).to_list()
        return rows[0]["keypoints"] if rows else None

    def blocks(self) -> Iterator[Block]:
        """Yield all landmarks in blocks, also those without an image."""
        query = self._landmarks.search().select(["image", "x", "y", "side", "vector"])
        with database_errors(self.folder):
            for batch in query.to_batches(READ_AT_ONCE):
                yield block_of(batch)

    @property
    @own_errors
    def indexed(self) -> bool:
        """Whether the landmarks have an index."""
        return bool(self._landmarks.list_indices())

    @own_errors
    def nearest(self, vectors: NDArray[np.float16]) -> IndexHits:
        """Return at most `COMPARED` near landmarks of each of (N, D) descriptors, by the index."""
        queries = vectors.astype(np.float32)
        probes = max(PROBES, self.landmark_count() // LANDMARKS_PER_PROBE)
        asked = self._landmarks.search(queries).distance_type("cosine").nprobes(probes)
        found = asked.limit(COMPARED).with_row_id(True).select(["_distance"]).to_arrow()
        if len(queries) > 1:
            query = found["query_index"].to_numpy().astype(np.intp)
        else:  # LanceDB numbers queries only where there are several.
            query = np.zeros(len(found), np.intp)
        # Read together: LanceDB's own exact comparison reads rows one by one, ten times slower.
        rows, which = np.unique(found["_rowid"].to_numpy(), return_inverse=True)
        taken = self._landmarks.take_row_ids(rows.tolist()).with_row_id()
        table = taken.select(["image", "x", "y", "side", "vector"]).to_arrow()
        block = block_of(table.sort_by("_rowid").combine_chunks())
        own = block.vectors[which].astype(np.float32)
        similarity = np.einsum("nd,nd->n", queries[query], own)
        return IndexHits(query, block.image[which], block.place[which], similarity)

    @own_errors
    def landmark_count(self) -> int:
        """Return the number of landmarks, also of those without an image."""
        return int(self._landmarks.count_rows())

    @own_errors
    def add(self, entries: Sequence[Indexed]) -> None:
        """Add images, or replace those of the same names, all together.

        Must be called within `writing`.
        """
        if not entries:
            return
        replaced = self._ids({entry.image.name for entry in entries})
        replaced -= {entry.image.id for entry in entries}
        self._landmarks.add(pa.concat_tables(map(landmark_rows, entries)))
        self._tiles.add(tile_rows(entries))
        self.put_images([entry.image for entry in entries])
        self._remove_parts(replaced)

    @own_errors
    def remove(self, images: Collection[int]) -> None:
        """Remove images; must be called within `writing`."""
        if not images:
            return
        self._images.delete(f"id IN ({', '.join(map(str, images))})")
        self._remove_parts(images)

    @own_errors
    def index(self, index_from: int | None = None) -> None:
        """Index the landmarks where many have no index; must be called within `writing`.

        Args:
            index_from: number of landmarks from which on; None: `INDEX_FROM`.
        """
        least = INDEX_FROM if index_from is None else index_from
        indices = self._landmarks.list_indices()
        if indices:
            statistics = self._landmarks.index_stats(indices[0].name)
            if statistics is not None and statistics.num_unindexed_rows >= max(least, 1):
                self._landmarks.optimize()
        elif self.landmark_count() >= least:
            self._landmarks.create_index("vector", config=IvfRq(distance_type="cosine"))

    @own_errors
    def compact(self, index_from: int | None = None) -> bool:
        """Merge the files of the tables, remove old ones, and index the landmarks.

        Must be called within `writing`.

        Args:
            index_from: see `index`.

        Returns:
            Whether the landmarks have an index.
        """
        self.index(index_from)
        for table in (self._images, self._tiles, self._landmarks):
            table.optimize(cleanup_older_than=KEPT, delete_unverified=True)
        return self.indexed

    @own_errors
    def orphans(self) -> set[int]:
        """Return the ids that tiles or landmarks have but no usable image."""
        ids = owners(self._tiles) | owners(self._landmarks)
        return ids - {each.id for each in self.images() if each.usable}

    @own_errors
    def tiled(self) -> set[int]:
        """Return the ids of images with tiles."""
        return owners(self._tiles)

    def _ids(self, names: Collection[str]) -> set[int]:
        """Return the ids of images by their names, without names that are unknown."""
        quoted = ", ".join("'" + name.replace("'", "''") + "'" for name in names)
        rows = self._images.search().where(f"name IN ({quoted})").select(["id"]).to_list()
        return {row["id"] for row in rows}

    @own_errors
    def put_images(self, images: Sequence[MapImage]) -> None:
        """Add rows of images, or replace those of the same names; within `writing`."""
        if not images:
            return
        rows = [[getattr(image, field.name) for image in images] for field in IMAGES]
        upsert = self._images.merge_insert("name").when_matched_update_all()
        upsert.when_not_matched_insert_all().execute(table_of(rows, IMAGES))

    def _remove_orphans(self) -> None:
        self._remove_parts(self.orphans())

    def _remove_parts(self, images: Collection[int]) -> None:
        if images:
            condition = f"image IN ({', '.join(map(str, images))})"
            self._landmarks.delete(condition)
            self._tiles.delete(condition)
