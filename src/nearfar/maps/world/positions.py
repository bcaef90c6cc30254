"""The table of a map that holds where its photographs were taken."""

from collections.abc import Mapping

import pyarrow as pa

from nearfar.maps.database import own_errors
from nearfar.maps.side_table import SideTable
from nearfar.maps.tables import schema_of
from nearfar.maps.world.photo_position import NUMBERS, PhotoPosition


class PositionStore(SideTable):
    """Where the images of a map were taken, by the image's id.

    Args:
        folder: folder of a map that exists.
    """

    NAME = "positions"
    SCHEMA = schema_of(image=pa.int64(), **dict.fromkeys(NUMBERS, pa.float64()))

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
        self._put(
            [
                {"image": image, **{name: getattr(each, name) for name in NUMBERS}}
                for image, each in positions.items()
            ]
        )
