"""Alignment: refine search hypotheses to affine transforms with fine features, and re-rank them.

The search compares the near image without tilt, reduced to 96 pixels. A foreshortened place ranks
low there, and its similarity transform is too rough for guided matching of keypoints. Alignment
describes both images in the frame of a hypothesis. Each cell of the near image is matched to its
nearest neighbour within reach. The affine transform with most inliers replaces the hypothesis.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.constants import DEFAULT, AlignmentConstants
from nearfar.descriptors import DenseDescriptor
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.mask import MaskedImage, usable
from nearfar.imaging.warp import resized, warped
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import Pyramid, distinct, unit
from nearfar.runtime.deadline import check
from nearfar.runtime.threads import in_order


class Frame:
    """The near image, reduced, with a margin that shows the far image around it.

    Args:
        near: the near image.
        descriptor: describes the cells.
        far: the pyramid of the far image, whose basis is used.
        side: longest side of the near image in the frame, in pixels.
        reach: distance from the expected position within which a cell is matched, in pixels of
            the frame.
        constants: of the alignment.
    """

    def __init__(
        self,
        near: MaskedImage,
        descriptor: DenseDescriptor,
        far: Pyramid,
        side: int,
        reach: float,
        constants: AlignmentConstants = DEFAULT.alignment,
    ) -> None:
        self._descriptor, self._far, self._constants = descriptor, far, constants
        reduced, reduced_from_near = resized(near.pixels, min(1.0, side / max(near.size)))
        height, width = reduced.shape[:2]
        margin = 8 * math.ceil(reach / 8) + constants.border
        right, bottom = margin + (-width % 16), margin + (-height % 16)
        padded = cv2.copyMakeBorder(reduced, margin, bottom, margin, right, cv2.BORDER_REFLECT_101)
        self._size = padded.shape[1], padded.shape[0]
        self._frame_from_near = translation(margin, margin) @ reduced_from_near
        vectors, self._cells = self._described(np.asarray(padded))
        own = self._cells - margin
        covered = ((own >= -0.5) & (own <= [width - 0.5, height - 0.5])).all(axis=1)
        if near.mask is not None:
            in_near = transform(np.linalg.inv(self._frame_from_near), self._cells)
            covered &= usable(near.mask, near.size, in_near)
        self._vectors, self._covered = vectors[covered], np.flatnonzero(covered)
        away = np.linalg.norm(self._cells[covered][:, np.newaxis] - self._cells, axis=2)
        self._penalty = np.where(away > reach, -2, 0).astype(np.float32)

    def aligned(self, far: MaskedImage, hypothesis: Hypothesis) -> Hypothesis | None:
        """Return the affine transform with most inlier cells; their similarity is its support.

        Args:
            far: the far image.
            hypothesis: where the near image may lie.

        Returns:
            None where too few cells agree.
        """
        check()
        vectors, frame_from_far = self._seen(far, hypothesis.far_from_near)
        similarity = self._vectors @ vectors.T + self._penalty
        each = np.arange(len(similarity))
        best = similarity.argmax(axis=1)
        mutual = similarity.argmax(axis=0)[best] == each
        matched = np.flatnonzero(
            mutual & (similarity[each, best] > self._constants.least_similarity)
        )
        if len(matched) < self._constants.least_cells:
            return None
        affine, inliers = cv2.estimateAffine2D(
            self._cells[self._covered[matched]],
            self._cells[best[matched]],
            method=cv2.RANSAC,
            ransacReprojThreshold=self._constants.tolerance,
            maxIters=300,
        )
        if affine is None:
            return None
        frame_from_frame = np.vstack([affine, [0, 0, 1]])
        far_from_near = np.linalg.inv(frame_from_far) @ frame_from_frame @ self._frame_from_near
        agreeing = matched[inliers[:, 0] > 0]
        support = float(similarity[agreeing, best[agreeing]].sum()) / len(similarity)
        return Hypothesis(far_from_near, support, "alignment")

    def similarity(self, far: MaskedImage, hypothesis: Hypothesis) -> float:
        """Return the mean similarity of the cells to those where the hypothesis puts them."""
        vectors, _ = self._seen(far, hypothesis.far_from_near)
        return float((self._vectors * vectors[self._covered]).sum(axis=1).mean())

    def _seen(
        self, far: MaskedImage, far_from_near: Matrix3
    ) -> tuple[NDArray[np.float32], Matrix3]:
        """Describe the far image in the frame: (N, D) cells, 0 outside it, and frame_from_far."""
        frame_from_far = self._frame_from_near @ np.linalg.inv(far_from_near)
        vectors, cells = self._described(warped(far.pixels, frame_from_far, self._size))
        own = transform(np.linalg.inv(frame_from_far), cells)
        vectors[~usable(far.mask, far.size, own)] = 0
        return vectors, frame_from_far

    def _described(self, pixels: RGBPixels) -> tuple[NDArray[np.float32], Coordinates]:
        """Return (N, D) unit vectors and (N, 2) places of the cells, in pixels."""
        features = self._descriptor.feature_map(pixels)
        own = features.values.reshape(-1, features.values.shape[-1]) - self._far.mean
        return unit(own @ self._far.basis), features.centres


def align(
    far: MaskedImage,
    near: MaskedImage,
    sought: Sequence[Hypothesis],
    descriptor: DenseDescriptor,
    features: Pyramid,
    constants: AlignmentConstants = DEFAULT.alignment,
) -> list[Hypothesis]:
    """Return affine hypotheses near those of the search, best first.

    Args:
        far: the far image.
        near: the near image.
        sought: from the search, similarity transforms.
        descriptor: the search's.
        features: of the far image, as the search saw it.
        constants: of the alignment.
    """
    if not sought:
        return []
    best_first = sorted(sought, key=lambda each: -each.support)
    origins = distinct(best_first, near.size, len(best_first))
    first, wide, *later = (
        Frame(near, descriptor, features, *each, constants)
        for each in (constants.first_frame, constants.wide_frame, *constants.later_frames)
    )
    moved = _aligned(far, [(each, each) for each in origins], first, constants)
    again = [(origin, origin) for _, origin in moved[: constants.again]]
    moved = [
        *moved[: constants.kept_first],
        *_aligned(far, again, wide, constants)[: constants.kept_wide],
    ]
    for frame in later:
        moved = _aligned(far, moved, frame, constants)[: constants.kept_later]
    likeness = in_order(lambda pair: later[-1].similarity(far, pair[0]), moved)
    found = [
        replace(each, support=support) for support, (each, _) in zip(likeness, moved, strict=True)
    ]
    found.sort(key=lambda each: -each.support)
    return distinct(found, near.size, len(found))


def _aligned(
    far: MaskedImage,
    begun: Sequence[tuple[Hypothesis, Hypothesis]],
    frame: Frame,
    constants: AlignmentConstants,
) -> list[tuple[Hypothesis, Hypothesis]]:
    """Align hypotheses in a frame; return those of a similar shape with their origins, best first.

    Args:
        far: the far image.
        begun: hypotheses and the hypotheses of the search that they were.
        frame: the frame.
        constants: of the alignment.
    """
    aligned = in_order(lambda pair: frame.aligned(far, pair[0]), begun)
    moved = [
        (_near(each, origin, constants), origin)
        for each, (_, origin) in zip(aligned, begun, strict=True)
    ]
    kept = [(each, origin) for each, origin in moved if each is not None]
    return sorted(kept, key=lambda pair: -pair[0].support)


def _near(
    moved: Hypothesis | None, origin: Hypothesis, constants: AlignmentConstants
) -> Hypothesis | None:
    """Return an aligned hypothesis unless its shape has become another's."""
    if moved is None:
        return None
    linear, before = moved.far_from_near[:2, :2], origin.far_from_near[:2, :2]
    longer, shorter = np.linalg.svd(linear, compute_uv=False)
    rescaled = math.sqrt(longer * shorter / abs(np.linalg.det(before)))
    same = (
        np.linalg.det(linear) > 0
        and longer < constants.most_foreshortened * shorter
        and 1 / constants.most_rescaled < rescaled < constants.most_rescaled
    )
    return moved if same else None
