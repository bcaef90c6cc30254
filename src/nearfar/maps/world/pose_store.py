"""The table of a map that holds cameras and poses of its images."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.database import own_errors
from nearfar.maps.side_table import SideTable
from nearfar.maps.tables import schema_of
from nearfar.maps.world.scene import PosedImage


class PoseStore(SideTable):
    """The cameras and poses of the images of a map.

    Args:
        folder: folder of a map that exists.
    """

    NAME = "views"
    SCHEMA = schema_of(
        image=pa.int64(),
        world=pa.string(),
        camera=pa.list_(pa.float64(), 4),
        world_from_camera=pa.list_(pa.float64(), 12),
        observed=pa.list_(pa.float64()),
        points=pa.list_(pa.float64()),
    )

    @own_errors
    def get(self, images: Sequence[int]) -> dict[int, PosedImage]:
        """Return the poses of images by their ids, without images that have none."""
        table = self._table()
        if table is None or not images:
            return {}
        rows = table.search().where(f"image IN ({', '.join(map(str, images))})").to_list()
        return {row["image"]: _posed(row) for row in rows}

    @own_errors
    def put(self, poses: Mapping[int, PosedImage]) -> None:
        """Add poses by the image's id, or replace those of the same images, all together.

        Must be called within `MapStore.writing`.
        """
        self._put([_row(image, posed) for image, posed in poses.items()])


def _row(image: int, posed: PosedImage) -> dict[str, Any]:
    camera = posed.camera
    return {
        "image": image,
        "world": posed.world,
        "camera": [camera.fx, camera.fy, camera.cx, camera.cy],
        "world_from_camera": np.column_stack([posed.rotation, posed.centre]).ravel(),
        "observed": posed.observed.ravel(),
        "points": posed.points.ravel(),
    }


def _posed(row: dict[str, Any]) -> PosedImage:
    world_from_camera = np.array(row["world_from_camera"]).reshape(3, 4)
    return PosedImage(
        CameraIntrinsics(*row["camera"]),
        world_from_camera[:, :3],
        world_from_camera[:, 3],
        np.array(row["observed"], np.float64).reshape(-1, 2),
        np.array(row["points"], np.float64).reshape(-1, 3),
        row["world"],
    )
