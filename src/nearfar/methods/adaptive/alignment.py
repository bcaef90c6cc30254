"""Alignment: places found by the search are made affine, and told apart, by their finer features.

The search knows the near image only straight on and only 96 pixels large, so that a foreshortened
place is far down its list and too rough for keypoints to match. Here both images are described in
the frame that a hypothesis gives, each cell of the near image looks for its like nearby, and the
affine transform that most of these agree on replaces the hypothesis.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.descriptors import DenseDescriptor
from nearfar.geometry.homography import transform, translation
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import Pyramid, distinct, unit
from nearfar.methods.adaptive.zoom import scaled, warped

FIRST = ((128, 40.0), (192, 56.0))
"""Longest side of the near image, and how far from the expected place a cell may lie, in pixels of
the frame: one pass over all hypotheses each."""
THEN = ((160, 32.0), (192, 24.0))
"""The same of the passes after these, one after the other."""
KEPT = 40
"""Hypotheses that go on after each of the first passes."""
LEAST_SIMILARITY, LEAST_CELLS = 0.2, 6
"""Of two cells that match, and of a transform."""
TOLERANCE = 8.0
"""How far from where the transform puts it a cell may lie, in pixels of the frame."""
MOST_RESIZED, MOST_FORESHORTENED = 2.5, 8.0
"""Change of scale against the first hypothesis, and ratio of the scales along the two axes."""
BORDER = 16
"""Pixels around what is compared, which the features of its edge see."""


class Frame:
    """The near image, reduced, with a margin in which the far image is looked at.

    Args:
        near: the near image.
        descriptor: describes the cells.
        far: the pyramid of the far image, whose basis is used.
        side: longest side of the near image in the frame, in pixels.
        reach: how far from the expected place a cell is sought, in pixels of the frame.
    """

    def __init__(
        self,
        near: RGBPixels,
        descriptor: DenseDescriptor,
        far: Pyramid,
        side: int,
        reach: float,
    ) -> None:
        self._descriptor, self._far = descriptor, far
        reduced, reduced_from_near = scaled(near, min(1.0, side / max(near.shape[:2])))
        height, width = reduced.shape[:2]
        margin = 8 * math.ceil(reach / 8) + BORDER
        right, bottom = margin + (-width % 16), margin + (-height % 16)
        padded = cv2.copyMakeBorder(reduced, margin, bottom, margin, right, cv2.BORDER_REFLECT_101)
        self._size = padded.shape[1], padded.shape[0]
        self._frame_from_near = translation(margin, margin) @ reduced_from_near
        vectors, self._cells = self._described(np.asarray(padded))
        own = self._cells - margin
        covered = ((own >= -0.5) & (own <= [width - 0.5, height - 0.5])).all(axis=1)
        self._vectors, self._covered = vectors[covered], np.flatnonzero(covered)
        away = np.linalg.norm(self._cells[covered][:, np.newaxis] - self._cells, axis=2)
        self._penalty = np.where(away > reach, -2, 0).astype(np.float32)

    def aligned(self, far: RGBPixels, hypothesis: Hypothesis) -> Hypothesis | None:
        """The affine transform that most cells agree on; its support is their likeness.

        Args:
            far: the far image.
            hypothesis: where the near image may lie.

        Returns:
            None where too few cells agree.
        """
        vectors, frame_from_far = self._seen(far, hypothesis.far_from_near)
        similarity = self._vectors @ vectors.T + self._penalty
        each = np.arange(len(similarity))
        best = similarity.argmax(axis=1)
        mutual = similarity.argmax(axis=0)[best] == each
        matched = np.flatnonzero(mutual & (similarity[each, best] > LEAST_SIMILARITY))
        if len(matched) < LEAST_CELLS:
            return None
        affine, inliers = cv2.estimateAffine2D(
            self._cells[self._covered[matched]],
            self._cells[best[matched]],
            method=cv2.RANSAC,
            ransacReprojThreshold=TOLERANCE,
            maxIters=300,
        )
        if affine is None:
            return None
        frame_from_frame = np.vstack([affine, [0, 0, 1]])
        far_from_near = np.linalg.inv(frame_from_far) @ frame_from_frame @ self._frame_from_near
        agreeing = matched[inliers[:, 0] > 0]
        support = float(similarity[agreeing, best[agreeing]].sum()) / len(similarity)
        return Hypothesis(far_from_near, support, "alignment")

    def likeness(self, far: RGBPixels, hypothesis: Hypothesis) -> float:
        """Mean similarity of the cells to what lies exactly where the hypothesis puts them."""
        vectors, _ = self._seen(far, hypothesis.far_from_near)
        return float((self._vectors * vectors[self._covered]).sum(axis=1).mean())

    def _seen(self, far: RGBPixels, far_from_near: Matrix3) -> tuple[NDArray[np.float32], Matrix3]:
        """(N, D) far cells in the frame, zero outside the far image, and frame from far pixels."""
        frame_from_far = self._frame_from_near @ np.linalg.inv(far_from_near)
        vectors, cells = self._described(warped(far, frame_from_far, self._size))
        own = transform(np.linalg.inv(frame_from_far), cells)
        height, width = far.shape[:2]
        vectors[~((own >= 0) & (own <= [width - 1, height - 1])).all(axis=1)] = 0
        return vectors, frame_from_far

    def _described(self, pixels: RGBPixels) -> tuple[NDArray[np.float32], Coordinates]:
        """(N, D) unit vectors and (N, 2) places of the cells, in pixels."""
        features = self._descriptor.feature_map(pixels)
        own = features.values.reshape(-1, features.values.shape[-1]) - self._far.mean
        return unit(own @ self._far.basis), features.centres


def align(
    far: RGBPixels,
    near: RGBPixels,
    sought: Sequence[Hypothesis],
    descriptor: DenseDescriptor,
    features: Pyramid,
) -> list[Hypothesis]:
    """Affine hypotheses near those of the search, best first.

    Args:
        far: the far image.
        near: the near image.
        sought: from the search, similarity transforms.
        descriptor: the search's.
        features: of the far image, as the search saw it.
    """
    if not sought:
        return []
    first, then = (
        [Frame(near, descriptor, features, side, reach) for side, reach in frames]
        for frames in (FIRST, THEN)
    )
    found = []
    for frame in first:
        begun = [(_near(frame.aligned(far, each), each), each) for each in sought]
        moved = [(each, origin) for each, origin in begun if each is not None]
        moved.sort(key=lambda pair: -pair[0].support)
        found += [_finished(far, *pair, then) for pair in moved[:KEPT]]
    best = sorted((each for each in found if each is not None), key=lambda each: -each.support)
    height, width = near.shape[:2]
    return distinct(best, (width, height), len(best))


def _finished(
    far: RGBPixels, start: Hypothesis, origin: Hypothesis, frames: Sequence[Frame]
) -> Hypothesis | None:
    """The result of the later passes, with its likeness as support."""
    moved = start
    for frame in frames:
        following = _near(frame.aligned(far, moved), origin)
        if following is None:
            return None
        moved = following
    return replace(moved, support=frames[-1].likeness(far, moved))


def _near(moved: Hypothesis | None, origin: Hypothesis) -> Hypothesis | None:
    """What an alignment has made of a hypothesis, unless that is another place altogether."""
    if moved is None:
        return None
    linear, before = moved.far_from_near[:2, :2], origin.far_from_near[:2, :2]
    longer, shorter = np.linalg.svd(linear, compute_uv=False)
    resized = math.sqrt(longer * shorter / abs(np.linalg.det(before)))
    same = (
        np.linalg.det(linear) > 0
        and longer < MOST_FORESHORTENED * shorter
        and 1 / MOST_RESIZED < resized < MOST_RESIZED
    )
    return moved if same else None
