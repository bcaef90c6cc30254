"""The near image warped into the coordinate system of the far image, strip by strip."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from nearfar.arrays import Matrix3
from nearfar.errors import ExportError
from nearfar.exports.ground import Ground
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.georeference import quiet_gdal
from nearfar.imaging.image import Image

MOST_PIXELS = 200_000_000
"""Largest number of pixels of a warped image."""
LONGEST_SOURCE = 32_766
"""Longest side of an image that OpenCV can sample."""
STRIP = 256
"""Rows that are warped at once."""
MARGIN = 1
"""Far pixels around the outline, which between its points may bend."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The pixels of a warped image on the ground.

    Attributes:
        width: in pixels.
        height: in pixels.
        world_from_corner: (3, 3) affine transform of GDAL: from pixels whose corners are integers.
        far_from_pixel: (3, 3) homography from pixels whose centres are integers to far pixels.
    """

    width: int
    height: int
    world_from_corner: Matrix3
    far_from_pixel: Matrix3

    @property
    def affine(self) -> Any:
        """Return rasterio's geotransform."""
        from rasterio import Affine

        return Affine(*self.world_from_corner[:2].ravel().tolist())


def grid_of(ground: Ground) -> Grid:
    """Choose the pixels of the warped image.

    They are the pixels of the far image, each divided into as many as keep the resolution of the
    near image. Where control points bend the far image, they are squares of its coordinate system.

    Raises:
        ExportError: there would be too many pixels.
    """
    scale = ground.subject.localization.scale_change or 1.0
    for parts in range(max(1, round(scale)), 0, -1):
        grid = _pixel_grid(ground, parts) if ground.place.affine else _square_grid(ground, parts)
        if grid.width * grid.height <= MOST_PIXELS:
            return grid
    raise ExportError(
        f"the outline has more than {MOST_PIXELS:,} pixels of the far image: the localization is "
        f"hardly right"
    )


def _pixel_grid(ground: Ground, parts: int) -> Grid:
    """Divide the pixels of the far image that the outline touches."""
    corner = np.floor(ground.outline.min(axis=0) + 0.5) - MARGIN
    columns, rows = np.ceil(ground.outline.max(axis=0) + 0.5) + MARGIN - corner
    far_corner = translation(*corner) @ np.diag([1 / parts, 1 / parts, 1])
    far_from_pixel = translation(-0.5, -0.5) @ far_corner @ translation(0.5, 0.5)
    world_from_far_corner = ground.place.world_from_pixel @ translation(-0.5, -0.5)
    return Grid(
        int(columns) * parts,
        int(rows) * parts,
        np.asarray(world_from_far_corner @ far_corner),
        np.asarray(far_from_pixel),
    )


def _square_grid(ground: Ground, parts: int) -> Grid:
    """Lay squares of the coordinate system, the first row in the north, over the outline."""
    middle = ground.outline.mean(axis=0)
    beside = ground.place.world(middle + np.array([[0, 0], [1, 0], [0, 1.0]]))
    side = float(np.sqrt((np.diff(beside[[0, 1, 0, 2]], axis=0)[[0, 2]] ** 2).sum() / 2)) / parts
    world = ground.place.world(ground.outline)
    west, south = world.min(axis=0) - MARGIN * parts * side
    east, north = world.max(axis=0) + MARGIN * parts * side
    world_from_corner = translation(west, north) @ np.diag([side, -side, 1])
    far_from_world = np.linalg.inv(ground.place.world_from_pixel)
    return Grid(
        int(np.ceil((east - west) / side)),
        int(np.ceil((north - south) / side)),
        np.asarray(world_from_corner),
        np.asarray(far_from_world @ world_from_corner @ translation(0.5, 0.5)),
    )


@contextmanager
def warped(ground: Ground, beside: Path) -> Iterator[Path]:
    """Yield a temporary GeoTIFF of the near image, red, green, blue and alpha, on its grid.

    Args:
        ground: the near image on the ground.
        beside: path in whose folder the file lies.

    Raises:
        ExportError: the near image or the warped one is too large.
        ImageError: the near image cannot be read.
    """
    import rasterio
    from rasterio.windows import Window

    near = ground.subject.full_near
    if max(near.pixels.shape[:2]) > LONGEST_SOURCE:
        raise ExportError(
            f"the near image has a side above {LONGEST_SOURCE} pixels: give a smaller one"
        )
    grid = grid_of(ground)
    with TemporaryDirectory(dir=beside.parent, prefix=".warped-") as folder, quiet_gdal():
        file = Path(folder) / "warped.tif"
        with rasterio.open(
            file, "w", driver="GTiff", width=grid.width, height=grid.height, count=4, dtype="uint8",
            crs=ground.place.crs, transform=grid.affine, photometric="RGB", alpha="YES",
            tiled=True, compress="DEFLATE", bigtiff="IF_SAFER",
        ) as out:  # fmt: skip
            for top in range(0, grid.height, STRIP):
                rows = min(STRIP, grid.height - top)
                strip = _strip(ground, near, grid, top, rows)
                window = Window(0, top, grid.width, rows)
                out.write(np.moveaxis(strip, -1, 0), window=window)
        yield file


def _strip(ground: Ground, near: Image, grid: Grid, top: int, rows: int) -> np.ndarray:
    """Return (rows, width, 4) pixels of some rows of the grid."""
    x, y = np.meshgrid(np.arange(grid.width), np.arange(top, top + rows))
    pixels = np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)
    at = ground.near_from_far(transform(grid.far_from_pixel, pixels))
    info = ground.subject.localization.near
    inside = ((at >= -0.5) & (at <= [info.width - 0.5, info.height - 0.5])).all(axis=1)
    working = transform(np.linalg.inv(near.original_from_working), at)
    place = np.where(np.isfinite(working), working, -1).astype(np.float32)
    places = place.reshape(rows, grid.width, 2)
    sampled = np.empty((rows, grid.width, 4), np.uint8)
    sampled[..., :3] = cv2.remap(
        near.pixels, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    seen = inside.reshape(rows, grid.width)
    if near.mask is not None:
        shown = near.mask.astype(np.uint8)
        seen = seen & (cv2.remap(shown, places, None, cv2.INTER_NEAREST) > 0)
    sampled[..., 3] = np.where(seen, 255, 0)
    sampled[~seen] = 0
    return sampled
