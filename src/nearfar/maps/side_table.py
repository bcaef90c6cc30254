"""A table of a map with at most one row for each image, which is made with its first row."""

from collections.abc import Collection, Sequence
from typing import Any, ClassVar

import pyarrow as pa

from nearfar.maps.database import connect, database_errors, open_table, own_errors
from nearfar.storage.locations import Location


class SideTable:
    """Reads and writes such a table; a class below names it and its columns.

    Args:
        folder: folder of a map that exists.

    Attributes:
        NAME: name of the table.
        SCHEMA: its columns; `image` is the image's id.
    """

    NAME: ClassVar[str]
    SCHEMA: ClassVar[pa.Schema]

    def __init__(self, folder: Location) -> None:
        self.folder = folder
        with database_errors(folder):
            self._database = connect(folder)

    @own_errors
    def ids(self) -> set[int]:
        """Return the ids of the images that have a row."""
        table = self._table()
        if table is None:
            return set()
        return {row["image"] for row in table.search().select(["image"]).to_list()}

    @own_errors
    def remove(self, images: Collection[int]) -> None:
        """Remove the rows of some images; must be called within `MapStore.writing`."""
        table = self._table()
        if table is not None and images:
            table.delete(f"image IN ({', '.join(map(str, images))})")

    def keep(self, images: Collection[int]) -> None:
        """Remove the rows of all other images; must be called within `MapStore.writing`."""
        self.remove(self.ids() - set(images))

    def _table(self) -> Any:
        """Open the table; return None before its first row is put."""
        return open_table(self._database, self.NAME, self.folder)

    def _put(self, rows: Sequence[dict[str, Any]]) -> None:
        """Add rows, or replace those of the same images, all together."""
        if not rows:
            return
        content = pa.Table.from_pylist(rows, self.SCHEMA)
        table = self._table()
        if table is None:
            self._database.create_table(self.NAME, content)
            return
        upsert = table.merge_insert("image").when_matched_update_all()
        upsert.when_not_matched_insert_all().execute(content)
