"""A made room with photographs on its walls, seen by cameras whose poses are exact."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.homography import scaling, transform
from nearfar.geometry.intrinsics import CameraIntrinsics

SIZE = (800, 560)
CAMERA = CameraIntrinsics(700, 700, 400.0, 280.0)
FINER = 2
"""Images are rendered so much larger, and reduced."""


@dataclass(frozen=True, eq=False)
class Facet:
    """A rectangle with a texture; x is to the right, y down, z ahead.

    Attributes:
        texture: (rows, columns, 3).
        corner: (3,) where its top left corner is.
        across: (3,) along its upper side.
        down: (3,) along its left side.
    """

    texture: RGBPixels
    corner: NDArray[np.float64]
    across: NDArray[np.float64]
    down: NDArray[np.float64]

    @property
    def world_from_texture(self) -> Matrix3:
        """Takes homogeneous pixels of the texture to points of the world."""
        rows, columns = self.texture.shape[:2]
        right, below = self.across / columns, self.down / rows
        return np.column_stack([right, below, self.corner + (right + below) / 2])


@dataclass(frozen=True, eq=False)
class Pose:
    """Of a camera in the room."""

    rotation: Matrix3
    centre: NDArray[np.float64]

    @staticmethod
    def of(x: float, y: float, z: float, turn: float = 0, tilt: float = 0) -> "Pose":
        """Looks ahead, turned to the right and tilted up, in degrees."""
        rotation = Rotation.from_euler("yx", [turn, tilt], degrees=True).as_matrix()
        return Pose(rotation, np.array([x, y, z], np.float64))

    @property
    def kitti(self) -> str:
        """A line of a KITTI pose file."""
        return " ".join(
            f"{value:.9g}" for value in np.column_stack([self.rotation, self.centre]).ravel()
        )

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """(4,) x, y, z, w."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_quat())

    def errors(self, rotation: Matrix3, centre: NDArray[np.float64]) -> tuple[float, float]:
        """Angle in degrees and distance of an estimate."""
        angle = Rotation.from_matrix(self.rotation.T @ rotation).magnitude()
        return float(np.degrees(angle)), float(np.linalg.norm(centre - self.centre))


@dataclass(frozen=True, eq=False)
class Room:
    """A back wall 8 m ahead, a wall on the left, and the floor."""

    facets: tuple[Facet, ...]

    @staticmethod
    def of(load: Callable[[str], RGBPixels]) -> "Room":
        """With photographs that `load` gives by name."""

        def row(*names: str) -> RGBPixels:
            height = 600
            photos = [load(name) for name in names]
            return np.hstack(
                [
                    cv2.resize(each, (each.shape[1] * height // each.shape[0], height))
                    for each in photos
                ]
            )

        def box(texture: RGBPixels, *vectors: tuple[float, float, float]) -> Facet:
            return Facet(texture, *(np.array(each, np.float64) for each in vectors))

        back = row("astronaut", "coffee", "chelsea")
        left = row("hubble_deep_field", "retina")
        floor = row("rocket", "page", "immunohistochemistry")
        return Room(
            (
                box(back, (-6, -3, 8), (12, 0, 0), (0, 5, 0)),
                box(left, (-6, -3, 2), (0, 0, 6), (0, 5, 0)),
                box(floor, (-6, 2, 8), (12, 0, 0), (0, 0, -6)),
            )
        )

    def seen(self, pose: Pose, camera: CameraIntrinsics = CAMERA) -> RGBPixels:
        """The image that a camera in the room takes."""
        width, height = SIZE
        finer = FINER * width, FINER * height
        canvas = np.full((finer[1], finer[0], 3), 90, np.uint8)
        for facet in self.facets:
            fine = scaling(FINER, FINER) @ _pixel_from_texture(facet, pose, camera)
            smooth = cv2.GaussianBlur(facet.texture, (0, 0), 0.6)
            warped = cv2.warpPerspective(smooth, fine, finer, flags=cv2.INTER_CUBIC)
            inside = np.full(facet.texture.shape[:2], 255, np.uint8)
            mask = cv2.warpPerspective(inside, fine, finer) > 127
            canvas[mask] = warped[mask]
        return np.asarray(cv2.resize(canvas, SIZE, interpolation=cv2.INTER_AREA))

    def points(
        self, pose: Pose, pixels: Coordinates, camera: CameraIntrinsics = CAMERA
    ) -> NDArray[np.float64]:
        """(N, 3) points of the room at the pixels of an image; NaN where it shows none."""
        found = np.full((len(pixels), 3), np.nan)
        for facet in self.facets:
            model = np.linalg.inv(_pixel_from_texture(facet, pose, camera))
            texels = transform(model, pixels)
            rows, columns = facet.texture.shape[:2]
            inside = ((texels > -0.5) & (texels < [columns - 0.5, rows - 0.5])).all(axis=1)
            flat = np.column_stack([texels[inside], np.ones(inside.sum())])
            found[inside] = flat @ facet.world_from_texture.T
        return found


def _pixel_from_texture(facet: Facet, pose: Pose, camera: CameraIntrinsics) -> Matrix3:
    world = facet.world_from_texture.copy()
    world[:, 2] -= pose.centre
    return np.asarray(camera.matrix @ pose.rotation.T @ world)
