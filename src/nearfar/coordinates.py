"""Answers in pixels of the working images as answers in pixels of the original ones."""

import numpy as np

from nearfar.arrays import Boxes, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import normalized
from nearfar.imaging.image import Image
from nearfar.landmarks import LandmarkMatches
from nearfar.models import Alternative, Candidate, Excluded, ModelKind
from nearfar.proposals import scaled_boxes


def model_in_original_pixels(
    model: Matrix3 | RelativePose | None, kind: ModelKind, far: Image, near: Image
) -> Matrix3 | RelativePose | None:
    """Convert a model from working to original pixels; a pose stays as it is."""
    if model is None or isinstance(model, RelativePose):
        return model
    near_working_from_original = np.linalg.inv(near.original_from_working)
    if kind == "homography":
        return normalized(far.original_from_working @ model @ near_working_from_original)
    fundamental = np.linalg.inv(far.original_from_working).T @ model @ near_working_from_original
    return np.asarray(fundamental / np.linalg.norm(fundamental))


def landmarks_in_original_pixels(
    matches: LandmarkMatches, far: Image, near: Image
) -> LandmarkMatches:
    """Return matched landmarks with their boxes in pixels of the original images."""
    return LandmarkMatches(
        boxes_in_original_pixels(matches.far_boxes, far),
        boxes_in_original_pixels(matches.near_boxes, near),
        matches.similarity,
    )


def boxes_in_original_pixels(boxes: Boxes, image: Image) -> Boxes:
    """Return (N, 4) boxes x, y, width, height in pixels of the original image."""
    height, width = image.pixels.shape[:2]
    return scaled_boxes(boxes, (width, height), (image.width, image.height))


def alternative_in_original_pixels(
    alternative: Alternative, far: Image, near: Image
) -> Alternative:
    """Return an alternative in pixels of the original images."""
    model = model_in_original_pixels(alternative.far_from_near, "homography", far, near)
    return Alternative(np.asarray(model), alternative.score)


def candidate_in_original_pixels(candidate: Candidate, far: Image, near: Image) -> Candidate:
    """Return a candidate in pixels of the original images."""
    model = model_in_original_pixels(candidate.far_from_near, "homography", far, near)
    return Candidate(np.asarray(model), candidate.score, candidate.source)


def excluded_in_original_pixels(
    excluded: Excluded | None, far: Image, near: Image
) -> Excluded | None:
    """Return what was left out in pixels of the original images; None where nothing was."""
    if excluded is None:
        return None
    return Excluded(
        excluded.matches,
        boxes_in_original_pixels(excluded.far_box[np.newaxis], far)[0],
        boxes_in_original_pixels(excluded.near_box[np.newaxis], near)[0],
    )
