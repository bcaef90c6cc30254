"""Agreement: does the rest of the near image look like what lies where the model puts it?

Point matches that agree on a model may all lie on one small thing that both pictures share.
Agreement is evidence that did not produce the model: the dense features of the near image, compared
in its frame with the features of the far image where the model, or the matches around, put them.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.constants import AgreementConstants
from nearfar.descriptors import DenseDescriptor
from nearfar.features.feature_map import FeatureMap
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.mask import MaskedImage, usable
from nearfar.imaging.warp import resized
from nearfar.models import Agreement
from nearfar.verification.placement import Placement


@dataclass(frozen=True, eq=False)
class NearCells:
    """The near image, reduced, with a margin, and its features: the same for every place.

    Attributes:
        near: the near image.
        features: of the frame.
        frame_from_near: near pixels to pixels of the frame.
        size: width and height of the frame in pixels.
    """

    near: MaskedImage
    features: FeatureMap
    frame_from_near: Matrix3
    size: tuple[int, int]


def near_cells(
    near: MaskedImage, descriptor: DenseDescriptor, constants: AgreementConstants
) -> NearCells:
    """Describe the near image for comparisons with several places.

    Args:
        near: the near image.
        descriptor: describes the cells.
        constants: of the comparison.
    """
    small, small_from_near = resized(near.pixels, min(1.0, constants.side / max(near.size)))
    height, width = small.shape[:2]
    margin = constants.margin
    right, bottom = margin + (-width % 16), margin + (-height % 16)
    padded = cv2.copyMakeBorder(small, margin, bottom, margin, right, cv2.BORDER_REFLECT_101)
    features = descriptor.feature_map(np.asarray(padded))
    frame_from_near = translation(margin, margin) @ small_from_near
    return NearCells(near, features, frame_from_near, (padded.shape[1], padded.shape[0]))


def agreement(
    far: MaskedImage,
    cells: NearCells,
    place: Placement,
    inliers: Coordinates,
    descriptor: DenseDescriptor,
    constants: AgreementConstants,
) -> Agreement | None:
    """Return the share of the near image's cells that agree with the far image.

    A cell agrees where it is more similar to what lies in its place than to nearly all cells around
    that place.

    Args:
        far: the far image.
        cells: of the near image.
        place: where the points of the near image lie in the far image.
        inliers: (N, 2) near points of the matches that this was fitted to.
        descriptor: describes the cells.
        constants: of the comparison.

    Returns:
        None where both images show too few of the cells to say, or too few have a known place.
    """
    near, near_map, frame_from_near = cells.near, cells.features, cells.frame_from_near
    far_map = descriptor.feature_map(place.seen(far.pixels, frame_from_near, cells.size))
    grid = near_map.values.shape[:2]
    in_near = transform(np.linalg.inv(frame_from_near), near_map.centres)
    in_far = place.far_points(in_near)
    own = usable(near.mask, near.size, in_near).reshape(grid)
    seen = usable(far.mask, far.size, in_far).reshape(grid)
    rank, compared = _rank(
        _centred(near_map.values, own), _centred(far_map.values, seen), seen, constants
    )
    shown = own & seen & (compared >= constants.least_around)
    agrees = rank <= constants.best_share * compared
    if shown.sum() < constants.least_cells:
        return None
    away = shown.copy()
    if len(inliers):
        apart = near_map.centres[:, np.newaxis] - transform(frame_from_near, inliers)
        away &= (np.linalg.norm(apart, axis=2).min(axis=1) > constants.away).reshape(grid)
    enough = away.sum() >= constants.least_cells
    return Agreement(float(agrees[shown].mean()), float(agrees[away].mean()) if enough else None)


def _centred(values: NDArray[np.float32], used: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Subtract the mean of the used cells and scale each cell to unit length."""
    if not used.any():
        return np.zeros_like(values)
    away = values - values[used].mean(axis=0)
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-6))


def _rank(
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    seen: NDArray[np.bool_],
    constants: AgreementConstants,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rank each cell's similarity at its place among its similarities to cells around.

    Returns:
        (rows, columns) number of cells around that are at least as similar as the best one within
        one cell, and number of cells around that the far image shows.
    """
    offsets = range(-constants.outer, constants.outer + 1)
    best = np.full(seen.shape, -np.inf, np.float32)
    around = []
    for down in offsets:
        for right in offsets:
            distance = np.hypot(down, right)
            if max(abs(down), abs(right)) <= 1:
                best = np.maximum(best, _similarity(near, far, seen, down, right))
            elif constants.inner <= distance <= constants.outer + 0.5:
                around.append(_similarity(near, far, seen, down, right))
    ring = np.array(around)
    shown = np.isfinite(ring)
    return (shown & (ring >= best)).sum(axis=0), shown.sum(axis=0)


def _similarity(
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    seen: NDArray[np.bool_],
    down: int,
    right: int,
) -> NDArray[np.float32]:
    """Return cosines of near cells with far cells at an offset; -inf where these are unseen."""
    rows, columns = seen.shape
    found = np.full(seen.shape, -np.inf, np.float32)
    own = (
        slice(max(0, -down), rows - max(0, down)),
        slice(max(0, -right), columns - max(0, right)),
    )
    other = (
        slice(max(0, down), rows - max(0, -down)),
        slice(max(0, right), columns - max(0, -right)),
    )
    cosine = (near[own] * far[other]).sum(axis=-1)
    found[own] = np.where(seen[other], cosine, -np.inf)
    return found
