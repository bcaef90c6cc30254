"""Map images whose camera and pose are known, and their table in the folder of a map."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.database import connect, database_errors, open_table, own_errors
from nearfar.storage.locations import Location

TABLE = "views"
_SCHEMA = pa.schema(
    [
        pa.field("image", pa.int64(), nullable=False),
        pa.field("world", pa.string(), nullable=False),
        pa.field("camera", pa.list_(pa.float64(), 4), nullable=False),
        pa.field("world_from_camera", pa.list_(pa.float64(), 12), nullable=False),
        pa.field("observed", pa.list_(pa.float64()), nullable=False),
        pa.field("points", pa.list_(pa.float64()), nullable=False),
    ]
)


@dataclass(frozen=True, eq=False)
class View:
    """Camera and pose of a map image, and what is known of the scene that it shows.

    Attributes:
        world: name of the model or the list of poses that it is from; views of the same world have
            the same frame.
        camera: in pixels of the original image; distortion is left out.
        rotation: (3, 3) takes directions in the camera to the world.
        centre: (3,) of the camera in the world.
        observed: (N, 2) pixels at which the image shows points of a model.
        points: (N, 3) these points in the world.
    """

    world: str
    camera: CameraIntrinsics
    rotation: Matrix3
    centre: NDArray[np.float64]
    observed: Coordinates
    points: NDArray[np.float64]

    def in_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points of the world in the frame of the camera."""
        return np.asarray((points - self.centre) @ self.rotation)

    def in_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) points of the frame of the camera in the world."""
        return np.asarray(points @ self.rotation.T + self.centre)

    def errors(self, points: NDArray[np.float64], pixels: Coordinates) -> NDArray[np.float64]:
        """(N,) distances in pixels between (N, 3) points as seen and (N, 2) pixels.

        Infinite for points that are not before the camera.
        """
        seen = self.in_camera(points) @ self.camera.matrix.T
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.linalg.norm(seen[:, :2] / seen[:, 2:] - pixels, axis=1)
        return np.where(seen[:, 2] > 0, apart, np.inf)


class ViewStore:
    """The views of a map.

    Args:
        folder: of a map that exists.
    """

    def __init__(self, folder: Location) -> None:
        self.folder = folder
        with database_errors(folder):
            self._database = connect(folder)

    @own_errors
    def get(self, images: Sequence[int]) -> dict[int, View]:
        """The views of those of some images that have one, by the image's id."""
        table = self._table()
        if table is None or not images:
            return {}
        rows = table.search().where(f"image IN ({', '.join(map(str, images))})").to_list()
        return {row["image"]: _view(row) for row in rows}

    @own_errors
    def ids(self) -> set[int]:
        """The images that have a view, by id."""
        table = self._table()
        if table is None:
            return set()
        return {row["image"] for row in table.search().select(["image"]).to_list()}

    @own_errors
    def put(self, views: Mapping[int, View]) -> None:
        """Add views by the image's id, or replace those of the same images, all together.

        Must be called within `MapStore.writing`.
        """
        rows = pa.Table.from_pylist([_row(image, view) for image, view in views.items()], _SCHEMA)
        table = self._table()
        if table is None:
            self._database.create_table(TABLE, rows)
            return
        upsert = table.merge_insert("image").when_matched_update_all()
        upsert.when_not_matched_insert_all().execute(rows)

    @own_errors
    def remove(self, images: Collection[int]) -> None:
        """Remove the views of some images; must be called within `MapStore.writing`."""
        table = self._table()
        if table is not None and images:
            table.delete(f"image IN ({', '.join(map(str, images))})")

    def _table(self) -> Any:
        """The table; None before the first view is there."""
        return open_table(self._database, TABLE, self.folder)


def _row(image: int, view: View) -> dict[str, Any]:
    camera = view.camera
    return {
        "image": image,
        "world": view.world,
        "camera": [camera.fx, camera.fy, camera.cx, camera.cy],
        "world_from_camera": np.column_stack([view.rotation, view.centre]).ravel(),
        "observed": view.observed.ravel(),
        "points": view.points.ravel(),
    }


def _view(row: dict[str, Any]) -> View:
    world_from_camera = np.array(row["world_from_camera"]).reshape(3, 4)
    return View(
        row["world"],
        CameraIntrinsics(*row["camera"]),
        world_from_camera[:, :3],
        world_from_camera[:, 3],
        np.array(row["observed"], np.float64).reshape(-1, 2),
        np.array(row["points"], np.float64).reshape(-1, 3),
    )
