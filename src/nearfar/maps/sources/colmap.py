"""COLMAP models: cameras, poses and points of the images of a map. Needs the extra `colmap`."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.errors import ImageError, IntrinsicsError, MapError
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import COLMAP_PIXEL_CENTRE, CameraIntrinsics, of_projection
from nearfar.imaging.decoding import read_orientation
from nearfar.imaging.orientation import MIRRORED, TRANSPOSED, UPRIGHT, displayed_from_stored
from nearfar.maps.images import copied
from nearfar.maps.sources import MAP_SOURCES, GivenImage, MapSource
from nearfar.maps.world.scene import PosedImage
from nearfar.runtime import require


@MAP_SOURCES.register("colmap")
class Colmap(MapSource):
    """Folder of cameras, images and points3D, binary or text, as COLMAP writes it."""

    def read(self, path: Path, camera: CameraIntrinsics | None) -> "ColmapModel":
        """See `MapSource.read`; `camera` is not used."""
        del camera
        return ColmapModel(path)


class ColmapModel:
    """A model that COLMAP wrote, binary or text.

    Args:
        path: folder of the model.

    Raises:
        MapError: the model cannot be read.
        MissingExtraError: the extra `colmap` is not installed.
    """

    def __init__(self, path: Path) -> None:
        require("colmap", "pycolmap")
        import pycolmap

        try:
            self._model: Any = pycolmap.Reconstruction(path)
        except Exception as error:  # COLMAP raises many kinds of errors for damaged files.
            raise MapError(f"the COLMAP model {path} cannot be read: {error}") from error
        self.path = path
        self._posed = {image.name: image for image in self._model.images.values() if image.has_pose}
        if not self._posed:
            raise MapError(f"the COLMAP model {path} has no image with a pose")

    def posed(self, images: Sequence[GivenImage]) -> dict[str, PosedImage]:
        """See `ImagePoses.posed`.

        An image of the model is the map image whose path ends with the model's name for it.

        Raises:
            MapError: no image is in the model, a name fits several, a size differs, or an EXIF
                orientation mirrors an image or cannot be read.
            StorageError: object storage does not answer.
        """
        of_name: dict[str, GivenImage] = {}
        for image in images:
            name = self._name_in_model(image.name) if image.usable else None
            if name is None:
                continue
            if name in of_name:
                raise MapError(
                    f"{name} of the COLMAP model {self.path} may be {of_name[name].name} or "
                    f"{image.name}: add the images of one of the folders alone"
                )
            of_name[name] = image
        if not of_name:
            raise MapError(
                f"no image is in the COLMAP model {self.path}, which names them "
                f"{next(iter(self._posed))}"
            )
        return {image.name: self._pose(self._posed[name], image) for name, image in of_name.items()}

    def _name_in_model(self, name: str) -> str | None:
        """Return the longest end of a map image's path that is a name of the model."""
        parts = PurePosixPath(name).parts
        ends = ("/".join(parts[start:]) for start in range(len(parts)))
        return next((end for end in ends if end in self._posed), None)

    def _pose(self, posed: Any, image: GivenImage) -> PosedImage:
        """Return camera and pose of an image as displayed."""
        camera = self._model.cameras[posed.camera_id]
        displayed_from_model = self._displayed_from_model(camera, image)
        rotation = np.eye(3)
        rotation[:2, :2] = displayed_from_model[:2, :2]
        matrix = displayed_from_model @ self._pinhole(camera).matrix @ rotation.T
        world_from_camera = posed.cam_from_world().inverse().matrix()
        seen = posed.get_observation_points2D()
        observed = np.array([each.xy for each in seen], np.float64).reshape(-1, 2)
        points = [self._model.points3D[each.point3D_id].xyz for each in seen]
        return PosedImage(
            of_projection(matrix),
            world_from_camera[:, :3] @ rotation.T,
            world_from_camera[:, 3],
            transform(displayed_from_model, observed - COLMAP_PIXEL_CENTRE),
            np.array(points, np.float64).reshape(-1, 3),
        )

    def _displayed_from_model(self, camera: Any, image: GivenImage) -> Matrix3:
        """Return the transform of pixels of the model to displayed pixels of an image.

        COLMAP reads pixels as they are stored. Where only the displayed image has the size of the
        model's, the model was made of an image that had been saved upright.
        """
        size, displayed = (camera.width, camera.height), (image.width, image.height)
        orientation = self._orientation(image) if size in (displayed, displayed[::-1]) else UPRIGHT
        stored = displayed[::-1] if orientation in TRANSPOSED else displayed
        if size == stored:
            if orientation in MIRRORED:
                raise MapError(
                    f"{image.name} is displayed mirrored, by its EXIF orientation, so no pose of "
                    f"the COLMAP model {self.path} fits: save it upright, and make the model again"
                )
            return displayed_from_stored(orientation, *displayed)
        if size == displayed:
            return np.eye(3)
        raise MapError(
            f"{image.name} has {image.width}x{image.height} pixels, in the COLMAP model "
            f"{self.path} {camera.width}x{camera.height}: use the images of the model"
        )

    def _orientation(self, image: GivenImage) -> int:
        if image.file is None:
            return UPRIGHT
        try:
            return read_orientation(copied(image.file))
        except ImageError as error:
            raise MapError(
                f"the EXIF orientation of {image.name} is not known, so that the COLMAP model "
                f"{self.path} may not fit it: {error}"
            ) from error

    def _pinhole(self, camera: Any) -> CameraIntrinsics:
        """Return the intrinsics without distortion, for pixels whose centres are at integers."""
        try:
            found = of_projection(camera.calibration_matrix())
        except IntrinsicsError as error:
            raise MapError(f"the COLMAP model {self.path}: {error}") from None
        return replace(found, cx=found.cx - COLMAP_PIXEL_CENTRE, cy=found.cy - COLMAP_PIXEL_CENTRE)
