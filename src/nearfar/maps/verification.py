"""Verify candidates: localize the query in tiles of map images, from the voted transforms on."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import UncertaintyConstants
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, normalized, outline, transform
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.tiles import Tile
from nearfar.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches
from nearfar.localizer import Localizer
from nearfar.maps.voting import Hypothesis
from nearfar.models import Excluded
from nearfar.verification.expected_error import ExpectedError, with_expected_error

SWAPPED_FROM = 1.25
"""Enlargement from query to map beyond which the map image is taken as the near image."""
FULL = 0.9
"""Least share of the footprint that a tile shows, relative to the tile that shows most of it."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A tile of a map image and the hypotheses that lie in it.

    Attributes:
        image: id of the map image.
        tile: the tile.
        hypotheses: transforms that place the query in the tile, best first; empty where only its
            expected place is known.
    """

    image: int
    tile: Tile
    hypotheses: tuple[Hypothesis, ...]

    @property
    def votes(self) -> float:
        """Votes for the best hypothesis; 0 where there is none."""
        return self.hypotheses[0].votes if self.hypotheses else 0.0


def group_by_tile(
    hypotheses: Iterable[Hypothesis], tiles: dict[int, list[Tile]], size: tuple[int, int]
) -> list[Candidate]:
    """Return the tiles in which the hypotheses lie, in their order.

    Args:
        hypotheses: best first.
        tiles: tiles of the images of all hypotheses, by the id of the image.
        size: width and height of the query, in pixels.
    """
    grouped: dict[tuple[int, Tile], list[Hypothesis]] = {}
    for each in hypotheses:
        if tiles[each.image]:
            tile = best_tile(tiles[each.image], each.map_from_query, size)
            grouped.setdefault((each.image, tile), []).append(each)
    return [Candidate(image, tile, tuple(found)) for (image, tile), found in grouped.items()]


def best_tile(tiles: Sequence[Tile], map_from_query: Matrix3, size: tuple[int, int]) -> Tile:
    """Return the finest tile that shows about as much of the query's footprint as any tile."""
    corners = transform(map_from_query, outline(*size))
    low, high = corners.min(axis=0), corners.max(axis=0)

    def shown(tile: Tile) -> float:
        first = np.maximum(low, [tile.left, tile.top])
        last = np.minimum(high, [tile.left + tile.width, tile.top + tile.height])
        return float(np.prod(np.maximum(last - first, 0)))

    most = max(map(shown, tiles))
    return max((tile for tile in tiles if shown(tile) >= FULL * most), key=lambda each: each.scale)


def localize_in_tile(
    localizer: Localizer,
    candidate: Candidate,
    tile: MaskedImage,
    query: MaskedImage,
    cameras: Intrinsics | None = None,
    budget: float = math.inf,
) -> Localization:
    """Localize the query in a tile, in pixels of the tile and of the original query.

    Args:
        localizer: localizes pairs of images.
        candidate: the tile and the hypotheses for it, which may be none.
        tile: the tile.
        query: the query at its original size.
        cameras: intrinsics of the original map image (far) and of the query (near); with them the
            model is a pose, without them a homography.
        budget: seconds for this tile.
    """
    tile_from_map = np.linalg.inv(candidate.tile.original_from_tile)
    expected = [tile_from_map @ each.map_from_query for each in candidate.hypotheses]
    known = None
    if cameras is not None:
        known = Intrinsics(in_tile(cameras.far, candidate.tile), cameras.near)
    if not expected or _enlargement(localizer, expected[0], query.pixels) <= SWAPPED_FROM:
        return localizer.localize(
            tile.pixels,
            query.pixels,
            intrinsics=known,
            expected=expected,
            far_mask=tile.mask,
            near_mask=query.mask,
            budget=budget,
        )
    inverse = [np.linalg.inv(each) for each in expected]
    swapped = None if known is None else Intrinsics(known.near, known.far)
    found = localizer.localize(
        query.pixels,
        tile.pixels,
        intrinsics=swapped,
        expected=inverse,
        far_mask=query.mask,
        near_mask=tile.mask,
        budget=budget,
    )
    return swap_roles(found, localizer.settings.constants.uncertainty)


def in_tile(camera: CameraIntrinsics | None, tile: Tile) -> CameraIntrinsics | None:
    """Return the camera of a map image in pixels of one of its tiles; None where unknown."""
    return None if camera is None else camera.transformed(np.linalg.inv(tile.original_from_tile))


def _enlargement(localizer: Localizer, tile_from_query: Matrix3, query: RGBPixels) -> float:
    """Return how much larger the tile shows the scene than the query at its working size."""
    scale = math.sqrt(abs(np.linalg.det(tile_from_query[:2, :2])))
    longest, largest = max(query.shape[:2]), localizer.settings.max_size
    return scale * (longest / largest if largest and longest > largest else 1.0)


def swap_roles(found: Localization, constants: UncertaintyConstants) -> Localization:
    """Return a localization by homography or pose with far and near image swapped.

    Args:
        found: the localization.
        constants: of the expected error, which is that of the other direction.
    """
    inverse = None if found.far_from_near is None else _inverse(found.far_from_near)
    corners = None
    if isinstance(inverse, np.ndarray):
        corners = footprint(inverse, found.far.width, found.far.height)
    points, landmarks, excluded = found.points, found.landmarks, found.excluded
    cameras = found.intrinsics
    return replace(
        found,
        far_from_near=inverse,
        scale_change=None if found.scale_change is None else 1 / found.scale_change,
        footprint=corners,
        points=PointMatches(points.near, points.far, points.inliers),
        landmarks=LandmarkMatches(landmarks.near_boxes, landmarks.far_boxes, landmarks.similarity),
        excluded=None if excluded is None else _swapped(excluded),
        alternatives=tuple(
            replace(each, far_from_near=_inverted(each.far_from_near))
            for each in found.alternatives
        ),
        candidates=tuple(
            replace(each, far_from_near=_inverted(each.far_from_near)) for each in found.candidates
        ),
        far=found.near,
        near=found.far,
        intrinsics=None if cameras is None else Intrinsics(cameras.near, cameras.far),
        expected_error=_expected_error(found, inverse, constants),
    )


def _expected_error(
    found: Localization, inverse: Matrix3 | RelativePose | None, constants: UncertaintyConstants
) -> ExpectedError | None:
    """Return the expected error of the inverse of what was found; that of a pose is the same."""
    if inverse is None or isinstance(inverse, RelativePose):
        return found.expected_error
    points, new_near = found.points, found.far
    return with_expected_error(
        inverse,
        "homography",
        points.near[points.inliers],
        points.far[points.inliers],
        (new_near.width, new_near.height),
        found.near.width / found.near.working_size[0],
        constants,
    )[1]


def _swapped(excluded: Excluded) -> Excluded:
    return replace(excluded, far_box=excluded.near_box, near_box=excluded.far_box)


def _inverse(model: Matrix3 | RelativePose) -> Matrix3 | RelativePose:
    return model.inverse() if isinstance(model, RelativePose) else _inverted(model)


def _inverted(homography: Matrix3) -> Matrix3:
    return normalized(np.linalg.inv(homography))
