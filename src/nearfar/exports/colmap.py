"""A COLMAP database of the two images. Needs the extra `export`.

In COLMAP the centre of the top left pixel is (0.5, 0.5), so half a pixel is added to keypoints and
principal points, and models between pixels are moved by it.
"""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.errors import ExportError
from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.exports.subject import ImageNames, indexed
from nearfar.geometry.calibrations import colmap_parameters
from nearfar.geometry.epipolar import RelativePose, essential_from_pose
from nearfar.geometry.homography import translation
from nearfar.geometry.intrinsics import COLMAP_PIXEL_CENTRE, CameraIntrinsics
from nearfar.imaging.image import ImageInfo
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import replaced

_GUESSED_FOCAL_LENGTH = 1.2
"""Focal length of an unknown camera, in longest sides of its image; COLMAP's default."""
_COLMAP_FROM_PIXEL = translation(COLMAP_PIXEL_CENTRE, COLMAP_PIXEL_CENTRE)
_PIXEL_FROM_COLMAP = translation(-COLMAP_PIXEL_CENTRE, -COLMAP_PIXEL_CENTRE)


@EXPORTERS.register("colmap")
class ColmapExporter(Exporter):
    """Cameras, images, keypoints, matches and, where it was localized, two-view geometry.

    The near image is image 1 and the far one image 2, so that COLMAP's `F`, `E`, `H` and
    `cam2_from_cam1` are `far_from_near`. The inlier matches are those of the localization. A camera
    that is not known is a SIMPLE_RADIAL one with COLMAP's guess of its focal length. With
    distortion there is no `F` and no `H`, which hold for undistorted pixels only.
    """

    file_name = "colmap.db"

    def __init__(self, name: str, settings: Settings) -> None:
        super().__init__(name, settings)
        require("export", "pycolmap")

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`.

        Raises:
            ExportError: there is a database of other images, or a pose without its intrinsics.
        """
        import pycolmap

        names, found = subject.names, subject.localization
        if isinstance(found.far_from_near, RelativePose) and subject.cameras is None:
            raise ExportError(
                "a COLMAP database of a pose needs the intrinsics that it was found with: give "
                "them again (intrinsics=)"
            )
        _check_own(path, names)
        known = subject.cameras
        far_camera, near_camera = (None, None) if known is None else (known.far, known.near)
        matches = indexed(found.points)
        with replaced(path) as out, pycolmap.Database.open(str(out)) as database:
            near = _write_image(database, names.near, found.near, near_camera)
            far = _write_image(database, names.far, found.far, far_camera)
            database.write_keypoints(near, matches.near + np.float32(COLMAP_PIXEL_CENTRE))
            database.write_keypoints(far, matches.far + np.float32(COLMAP_PIXEL_CENTRE))
            database.write_matches(near, far, matches.pairs.astype(np.uint32))
            if found.localized:
                geometry = _two_view_geometry(subject)
                geometry.inlier_matches = matches.pairs[matches.inliers].astype(np.uint32)
                database.write_two_view_geometry(near, far, geometry)
        return [path]


def _check_own(path: Path, names: ImageNames) -> None:
    """Refuse to replace a database of other images."""
    if not path.exists():
        return
    # Unless another process writes to it, "immutable" leaves no log of SQLite beside the database.
    mode = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "immutable=1"
    try:
        # Not through pycolmap, which updates databases of older versions.
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True)) as database:
            there = {name for (name,) in database.execute("SELECT name FROM images")}
    except sqlite3.Error as error:
        raise ExportError(f"{path} is no COLMAP database: remove it first") from error
    if there - {names.far, names.near}:
        raise ExportError(f"{path} is a COLMAP database of other images: give another path")


def _write_image(database: Any, name: str, image: ImageInfo, known: CameraIntrinsics | None) -> int:
    import pycolmap

    camera_id = database.write_camera(_camera(image, known))
    written: int = database.write_image(pycolmap.Image(name=name, camera_id=camera_id))
    return written


def _camera(image: ImageInfo, known: CameraIntrinsics | None) -> Any:
    import pycolmap

    if known is None:
        guess = _GUESSED_FOCAL_LENGTH * max(image.width, image.height)
        return pycolmap.Camera(
            model="SIMPLE_RADIAL",
            width=image.width,
            height=image.height,
            params=[guess, image.width / 2, image.height / 2, 0],
        )
    model, parameters = colmap_parameters(known)
    return pycolmap.Camera(
        model=model,
        width=image.width,
        height=image.height,
        params=parameters,
        has_prior_focal_length=known.origin == "given",
    )


def _two_view_geometry(subject: Subject) -> Any:
    import pycolmap

    found = subject.localization.far_from_near
    kinds = pycolmap.TwoViewGeometryConfiguration
    geometry = pycolmap.TwoViewGeometry()
    distorted = subject.cameras is not None and subject.cameras.distorted
    if isinstance(found, RelativePose):
        geometry.config = kinds.CALIBRATED
        geometry.E = essential_from_pose(found)
        rotation = pycolmap.Rotation3d(found.rotation)
        geometry.cam2_from_cam1 = pycolmap.Rigid3d(rotation, found.translation)
    elif subject.localization.model == "homography":
        geometry.config = kinds.PLANAR_OR_PANORAMIC
        if distorted:
            return geometry
        geometry.H = _COLMAP_FROM_PIXEL @ np.asarray(found) @ _PIXEL_FROM_COLMAP
    else:
        geometry.config = kinds.UNCALIBRATED
        if distorted:
            return geometry
        geometry.F = _PIXEL_FROM_COLMAP.T @ np.asarray(found) @ _PIXEL_FROM_COLMAP
    return geometry
