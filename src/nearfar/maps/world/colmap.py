"""COLMAP models: cameras, poses and points of the images of a map. Needs the extra `colmap`."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from nearfar.errors import IntrinsicsError, MapError
from nearfar.geometry.intrinsics import COLMAP_PIXEL_CENTRE, CameraIntrinsics
from nearfar.maps.tables import MapImage
from nearfar.maps.world.views import View
from nearfar.runtime.extras import require


class ColmapModel:
    """A model that COLMAP wrote, binary or text, and its views.

    Args:
        folder: of the model.

    Raises:
        MapError: the model cannot be read.
        MissingExtraError: the extra `colmap` is not installed.
    """

    def __init__(self, folder: Path) -> None:
        require("colmap", "pycolmap")
        import pycolmap

        try:
            self._model: Any = pycolmap.Reconstruction(folder)
        except Exception as error:  # Damaged files make COLMAP raise whatever it likes.
            raise MapError(f"the COLMAP model {folder} cannot be read: {error}") from error
        self.folder = folder
        self._posed = {image.name: image for image in self._model.images.values() if image.has_pose}
        if not self._posed:
            raise MapError(f"the COLMAP model {folder} has no image with a pose")

    def views(self, world: str, images: Iterable[MapImage]) -> dict[int, View]:
        """The views of those of some map images that are in the model, by the image's id.

        An image of the model is the map image whose path ends with its name.

        Args:
            world: name for the model.
            images: of the map.

        Raises:
            MapError: none of them is in the model, or a name fits several, or a size differs.
        """
        of_name: dict[str, MapImage] = {}
        for image in images:
            name = self._name_in_model(image.name)
            if name is None:
                continue
            if name in of_name:
                raise MapError(
                    f"{name} of the COLMAP model {self.folder} may be {of_name[name].name} or "
                    f"{image.name}: add the images of one of the folders alone"
                )
            of_name[name] = image
        if not of_name:
            raise MapError(
                f"no image is in the COLMAP model {self.folder}, which names them "
                f"{next(iter(self._posed))}"
            )
        return {
            image.id: self._view(world, self._posed[name], image) for name, image in of_name.items()
        }

    def _name_in_model(self, name: str) -> str | None:
        """The longest end of a map image's path that the model has as a name."""
        parts = PurePosixPath(name).parts
        ends = ("/".join(parts[start:]) for start in range(len(parts)))
        return next((end for end in ends if end in self._posed), None)

    def _view(self, world: str, posed: Any, image: MapImage) -> View:
        camera = self._model.cameras[posed.camera_id]
        if (camera.width, camera.height) != (image.width, image.height):
            raise MapError(
                f"{image.name} has {image.width}x{image.height} pixels, in the COLMAP model "
                f"{self.folder} {camera.width}x{camera.height}: use the images of the model"
            )
        world_from_camera = posed.cam_from_world().inverse().matrix()
        seen = posed.get_observation_points2D()
        observed = np.array([each.xy for each in seen], np.float64).reshape(-1, 2)
        points = [self._model.points3D[each.point3D_id].xyz for each in seen]
        return View(
            world,
            self._pinhole(camera),
            world_from_camera[:, :3],
            world_from_camera[:, 3],
            observed - COLMAP_PIXEL_CENTRE,
            np.array(points, np.float64).reshape(-1, 3),
        )

    def _pinhole(self, camera: Any) -> CameraIntrinsics:
        try:
            found = CameraIntrinsics(*camera.calibration_matrix()[[0, 1, 0, 1], [0, 1, 2, 2]])
        except IntrinsicsError as error:
            raise MapError(f"the COLMAP model {self.folder}: {error}") from None
        return replace(found, cx=found.cx - COLMAP_PIXEL_CENTRE, cy=found.cy - COLMAP_PIXEL_CENTRE)
