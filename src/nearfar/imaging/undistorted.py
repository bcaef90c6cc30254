"""Images without the distortion of their lens."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nearfar.arrays import Boxes, Coordinates, Matrix3
from nearfar.errors import IntrinsicsError
from nearfar.geometry.homography import scaling, transform, translation
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import Image
from nearfar.imaging.mask import filled, without_border

WIDEST = float(np.tan(np.radians(60.0)))
"""Largest distance of a direction from the axis in an outline, at 60 degrees: a plane shows wider
directions more than four times enlarged."""
SIDE_POINTS = 16
"""Number of points of an outline on each side of an image with distortion."""
_HALVINGS = 40
_STEP = 4
"""Distance in pixels of the points that are bent by the lens; between them the map is linear, which
is exact to a hundredth of a pixel."""


@dataclass(frozen=True, eq=False)
class View:
    """An image as methods see it: as a pinhole camera would have taken it.

    Attributes:
        image: the image; its size is that of the frame in undistorted pixels.
        camera: camera of the original image, for its size; None where it is not known.
        undistorted_from_frame: takes pixels of the frame to undistorted pixels of the camera.
        size: width and height of the original image in pixels.
    """

    image: Image
    camera: CameraIntrinsics | None
    undistorted_from_frame: Matrix3
    size: tuple[int, int]

    @property
    def distorted(self) -> bool:
        """Whether the original image has distortion."""
        return self.camera is not None and self.camera.lens is not None

    @property
    def pinhole(self) -> CameraIntrinsics | None:
        """The camera without its lens in pixels of the frame; None without a camera."""
        if self.camera is None:
            return None
        moved = self.camera.transformed(np.linalg.inv(self.undistorted_from_frame))
        return replace(moved, lens=None)

    def original(self, xy: Coordinates) -> Coordinates:
        """Return pixels of the original image at (N, 2) pixels of the frame; NaN where none."""
        if self.camera is None or self.camera.lens is None:
            return np.asarray(xy, np.float64)
        return self.camera.distorted(transform(self.undistorted_from_frame, xy))

    def frame(self, xy: Coordinates) -> Coordinates:
        """Return pixels of the frame at (N, 2) pixels of the original image; NaN where none."""
        if self.camera is None or self.camera.lens is None:
            return np.asarray(xy, np.float64)
        return transform(np.linalg.inv(self.undistorted_from_frame), self.camera.undistorted(xy))

    def original_boxes(self, boxes: Boxes) -> Boxes:
        """Return (N, 4) boxes x, y, width, height of the original image around those of the frame.

        A box that the lens does not show becomes one pixel at the top left.
        """
        return _boxes(boxes, self.original, self.size) if self.distorted else boxes

    def frame_boxes(self, boxes: Boxes) -> Boxes:
        """Return (N, 4) boxes of the frame around those of the original image."""
        size = self.image.width, self.image.height
        return _boxes(boxes, self.frame, size) if self.distorted else boxes


def view_of(image: Image, camera: CameraIntrinsics | None, *, masked: bool = True) -> View:
    """Return an image without the distortion of its lens.

    Near the principal point it has the resolution of the image. It shows the part of the image
    within its outline, see `undistorted_outline`.

    Args:
        image: the image, at its working size.
        camera: its camera, for the original size of the image; None where it is not known.
        masked: mask pixels that the image does not show; they are filled in any case.

    Raises:
        IntrinsicsError: the lens shows nothing of the image.
    """
    size = image.width, image.height
    if camera is None or camera.lens is None:
        return View(image, camera, np.eye(3), size)
    border = undistorted_outline(camera, *size)
    if not np.isfinite(border).all():
        raise IntrinsicsError(
            "the distortion of the camera fits no part of the image: check its coefficients, and "
            "the size of the images that it was calibrated with"
        )
    low, high = np.floor(border.min(axis=0)), np.ceil(border.max(axis=0))
    width, height = (int(side) for side in high - low + 1)
    frame = translation(*low)
    height_now, width_now = image.pixels.shape[:2]
    working = (
        max(1, round(width * width_now / size[0])),
        max(1, round(height * height_now / size[1])),
    )
    undistorted_from_working = frame @ scaling(width / working[0], height / working[1])
    at = _sources(camera, undistorted_from_working, working)
    working_from_original = np.linalg.inv(image.original_from_working)
    at = transform(working_from_original, at.reshape(-1, 2)).reshape(at.shape)
    with np.errstate(invalid="ignore"):
        inside = (at >= -0.5) & (at <= [width_now - 0.5, height_now - 0.5])
    used = np.asarray(inside.all(axis=2))
    if image.mask is not None:
        x, y = np.rint(np.where(used[..., np.newaxis], at, 0)).astype(np.intp).transpose(2, 0, 1)
        used &= image.mask[np.clip(y, 0, height_now - 1), np.clip(x, 0, width_now - 1)]
    at = np.where(np.isfinite(at), at, -1e4).astype(np.float32)
    pixels = cv2.remap(image.pixels, at, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    if not used.all():
        pixels, used = filled(pixels, used), without_border(used)
    keep = masked or image.mask is not None
    pixels = np.ascontiguousarray(pixels)
    pixels.flags.writeable = False
    mask = used if keep and not used.all() else None
    seen = replace(image, pixels=pixels, width=width, height=height, mask=mask)
    return View(seen, camera, frame, size)


def undistorted_outline(camera: CameraIntrinsics, width: int, height: int) -> Coordinates:
    """Return the outline of an image in undistorted pixels.

    Where the lens shows nothing at the border, or what lies over 60 degrees from its axis, the
    outline is drawn towards the principal point.

    Args:
        camera: camera with a lens, for this size of images.
        width: width of the image in pixels.
        height: height of the image in pixels.

    Returns:
        (4 x `SIDE_POINTS`, 2), clockwise from the top left corner; NaN where the lens shows nothing
        of the image.
    """
    border = sides(width, height)
    centre = np.array([camera.cx, camera.cy])
    most = np.ones(len(border))
    found = _undistorted(camera, border)
    low, high = np.zeros(len(border)), most
    outside = ~np.isfinite(found).all(axis=1)
    if outside.any():
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            tried = _undistorted(camera, centre + middle[:, np.newaxis] * (border - centre))
            seen = np.isfinite(tried).all(axis=1)
            found[outside & seen] = tried[outside & seen]
            low, high = np.where(seen, middle, low), np.where(seen, high, middle)
    return found


def _undistorted(camera: CameraIntrinsics, xy: Coordinates) -> Coordinates:
    """Return undistorted pixels; NaN for what is too wide for an outline."""
    found = camera.undistorted(xy)
    direction = (found - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    with np.errstate(invalid="ignore"):
        within = np.linalg.norm(direction, axis=1) <= WIDEST
    return np.where(within[:, np.newaxis], found, np.nan)


def sides(width: int, height: int) -> Coordinates:
    """Return (4 x `SIDE_POINTS`, 2) points on the outer border of an image, each side alike.

    They go clockwise from the top left corner; every `SIDE_POINTS`th one is a corner.
    """
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    share = np.arange(SIDE_POINTS)[:, np.newaxis] / SIDE_POINTS
    parts = [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    return np.vstack(parts)


def _sources(
    camera: CameraIntrinsics, undistorted_from_working: Matrix3, size: tuple[int, int]
) -> Coordinates:
    """Return (height, width, 2) pixels of the original image that pixels of the frame show."""
    width, height = size
    columns, rows = (side // _STEP + 2 for side in size)
    x, y = np.meshgrid(np.arange(columns) * _STEP, np.arange(rows) * _STEP)
    grid = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    at = camera.distorted(transform(undistorted_from_working, grid)).reshape(rows, columns, 2)
    across = _interpolated(at.transpose(1, 0, 2), width).transpose(1, 0, 2)
    return _interpolated(across, height)


def _interpolated(values: Coordinates, number: int) -> Coordinates:
    """Return the first values along the first axis, `_STEP` to each given one, linearly."""
    place = np.arange(number)
    before, share = place // _STEP, (place % _STEP / _STEP)[:, np.newaxis, np.newaxis]
    return np.asarray(values[before] * (1 - share) + values[before + 1] * share)


def _boxes(
    boxes: Boxes, mapped: Callable[[Coordinates], Coordinates], size: tuple[int, int]
) -> Boxes:
    """Return the (N, 4) boxes around the mapped points of boxes, within an image."""
    steps = np.linspace(0, 1, 9)
    unit = np.array([[x, y] for x in steps for y in steps])
    found = np.zeros_like(boxes)
    for row, (x, y, width, height) in enumerate(boxes.tolist()):
        points = mapped(unit * [width, height] + [x - 0.5, y - 0.5])
        seen = points[np.isfinite(points).all(axis=1)]
        if not len(seen):
            found[row] = 0, 0, 1, 1
            continue
        low = np.clip(np.rint(seen.min(axis=0) + 0.5), 0, np.array(size) - 1)
        high = np.clip(np.rint(seen.max(axis=0) + 0.5), low + 1, size)
        found[row] = [*low, *(high - low)]
    return found
