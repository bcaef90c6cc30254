"""A localization on the ground: its georeference, its control points, and both ways of mapping."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates
from nearfar.errors import ExportError
from nearfar.exports.subject import Subject
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.georeference import Georeference, georeference
from nearfar.localization import Localization
from nearfar.maps.world.places import GeoPlace, geo_place

COLUMNS, ROWS = 5, 4
"""Cells of the near image, each of which gives one control point at most."""
LEAST_POINTS = 4
"""Least number of control points that fix a homography."""


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Pixels of the near image and their places on the ground.

    Attributes:
        near: (N, 2) pixels of the near image, whose centres are integers.
        world: (N, 2) easting and northing, or longitude and latitude.
    """

    near: Coordinates
    world: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ground:
    """A near image whose far image is georeferenced.

    Attributes:
        subject: the localization.
        place: georeference of the far image.
        outline: footprint of the near image, in far pixels.
    """

    subject: Subject
    place: Georeference
    outline: Coordinates

    @property
    def _found(self) -> Localization:
        return self.subject.localization

    def far_from_near(self, near: Coordinates) -> Coordinates:
        """Return the (N, 2) far pixels of (N, 2) near pixels, through both lenses."""
        return self._found.map_points(near)

    def near_from_far(self, far: Coordinates) -> Coordinates:
        """Return the (N, 2) near pixels of (N, 2) far pixels; NaN where a lens shows nothing."""
        known = self._found.intrinsics or Intrinsics(None, None)
        straight = far if known.far is None else known.far.undistorted(far)
        with np.errstate(divide="ignore", invalid="ignore"):
            mapped = transform(np.linalg.inv(np.asarray(self._found.far_from_near)), straight)
        return mapped if known.near is None else known.near.distorted(mapped)

    def world(self, near: Coordinates) -> NDArray[np.float64]:
        """Return the (N, 2) places of (N, 2) near pixels."""
        return self.place.world(self.far_from_near(near))

    def control_points(self) -> ControlPoints:
        """Choose inliers that are spread over the near image, and place them by the model.

        The model, with the lenses, smooths the matches: a single match may be 3 pixels off.

        Raises:
            ExportError: there are too few inliers.
        """
        found = self._found
        near = found.points.near[found.points.inliers]
        chosen = near[_spread(near, found.near.width, found.near.height)]
        world = self.world(chosen)
        there = np.isfinite(world).all(axis=1)
        if there.sum() < LEAST_POINTS:
            raise ExportError(
                "control points need matches all over the near image, which this localization "
                "lacks: localize the images again"
            )
        return ControlPoints(chosen[there], world[there])


def _spread(near: Coordinates, width: int, height: int) -> NDArray[np.intp]:
    """Return the row of the point nearest to the centre of each cell of the image that has one."""
    cells = near * [COLUMNS / width, ROWS / height]
    inside = np.floor(np.clip(cells, 0, [COLUMNS - 1e-9, ROWS - 1e-9]))
    away = np.linalg.norm(cells - inside - 0.5, axis=1)
    order = np.argsort(away, kind="stable")
    _, first = np.unique(inside[order], axis=0, return_index=True)
    return np.asarray(order[first], np.intp)


def ground_of(subject: Subject) -> Ground:
    """Return a localization on the ground.

    Raises:
        ExportError: no homography was found, or the far image is not georeferenced.
        ImageError: the far image cannot be read, or is stored turned.
        MissingExtraError: the extra `geo` is not installed.
    """
    outline = outline_of(subject.localization)
    file = subject.localization.far.path
    place = None if file is None or not file.is_file() else georeference(file)
    if place is None:
        raise ExportError(
            "the far image is not georeferenced: use a GeoTIFF, or put a world file with a .prj "
            "file, or an .aux.xml file, beside it"
        )
    return Ground(subject, place, outline)


def outline_of(found: Localization) -> Coordinates:
    """Return the footprint.

    Raises:
        ExportError: there is none.
    """
    if found.footprint is not None:
        return found.footprint
    if not found.localized:
        why = f"failed ({found.reason})"
    elif found.model == "homography":
        why = "has a horizon that crosses the near image"
    else:
        why = f"is a {found.model}"
    raise ExportError(f"the localization {why}: an outline needs a homography (--model homography)")


def place_of(found: Localization) -> GeoPlace | None:
    """Return where the near image lies on the Earth; None where that is not known.

    Raises:
        ImageError: the far image cannot be read, or is stored turned.
        MissingExtraError: the far image is georeferenced and the extra `geo` is not installed.
    """
    file = found.far.path
    if found.model != "homography" or not found.localized or file is None or not file.is_file():
        return None
    size = found.near.width, found.near.height
    expected = None if found.expected_error is None else found.expected_error.mean
    return geo_place(file, np.asarray(found.far_from_near), size, found.intrinsics, expected)
