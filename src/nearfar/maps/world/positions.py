"""The table of a map that holds where its photographs were taken."""

from collections.abc import Collection, Mapping
from typing import Any

import pyarrow as pa

from nearfar.maps.database import connect, database_errors, open_table, own_errors
from nearfar.maps.tables import schema_of
from nearfar.maps.world.photo_position import NUMBERS, PhotoPosition
from nearfar.storage.locations import Location

TABLE = "positions"
_SCHEMA = schema_of(image=pa.int64(), **dict.fromkeys(NUMBERS, pa.float64()))


class PositionStore:
    """Where the images of a map were taken, by the image's id.

    Args:
        folder: folder of a map that exists.
    """

    def __init__(self, folder: Location) -> None:
        self.folder = folder
        with database_errors(folder):
            self._database = connect(folder)

    @own_errors
    def all(self) -> dict[int, PhotoPosition]:
        """Return the positions of all images that were looked at; of some no place is known."""
        table = self._table()
        if table is None:
            return {}
        rows = table.search().to_list()
        return {row["image"]: PhotoPosition(*(row[name] for name in NUMBERS)) for row in rows}

    @own_errors
    def put(self, positions: Mapping[int, PhotoPosition]) -> None:
        """Add positions, or replace those of the same images; within `MapStore.writing`."""
        if not positions:
            return
        rows: list[dict[str, Any]] = [
            {"image": image, **{name: getattr(each, name) for name in NUMBERS}}
            for image, each in positions.items()
        ]
        content = pa.Table.from_pylist(rows, _SCHEMA)
        table = self._table()
        if table is None:
            self._database.create_table(TABLE, content)
            return
        upsert = table.merge_insert("image").when_matched_update_all()
        upsert.when_not_matched_insert_all().execute(content)

    @own_errors
    def keep(self, images: Collection[int]) -> None:
        """Remove the positions of all other images; within `MapStore.writing`."""
        table = self._table()
        gone = self.all().keys() - set(images)
        if table is not None and gone:
            table.delete(f"image IN ({', '.join(map(str, gone))})")

    def _table(self) -> Any:
        """Open the table; return None before the first position is put."""
        return open_table(self._database, TABLE, self.folder)
