"""Localizations of images with distortion, in undistorted and in original pixels."""

from dataclasses import replace

import numpy as np

from nearfar.arrays import Coordinates, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, normalized, transform
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.image import ImageInfo, ImagePair
from nearfar.imaging.undistorted import View, undistorted_outline, view_of
from nearfar.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches
from nearfar.models import Excluded, ModelKind
from nearfar.verification.expected_error import ExpectedError


def in_original_pixels(
    found: Localization, far: View, near: View, infos: tuple[ImageInfo, ImageInfo]
) -> Localization:
    """Return a localization of two views as one of their original images.

    Args:
        found: in pixels of the frames of both views.
        far: the far view.
        near: the near view.
        infos: paths and sizes of the far and the near image.
    """
    known = Intrinsics(far.camera, near.camera)
    if not known.distorted:
        return replace(found, intrinsics=None if known == UNKNOWN else known)
    model = _moved(found.far_from_near, found.model, far, near)
    outline = None
    if found.model == "homography" and isinstance(model, np.ndarray):
        outline = outline_in_far(model, known, *near.size)
    points, boxes, excluded = found.points, found.landmarks, found.excluded
    far_xy, near_xy = far.original(points.far), near.original(points.near)
    seen = np.isfinite(np.hstack([far_xy, near_xy])).all(axis=1)
    return replace(
        found,
        far_from_near=model,
        footprint=outline,
        points=PointMatches(far_xy[seen], near_xy[seen], points.inliers[seen]),
        landmarks=LandmarkMatches(
            far.original_boxes(boxes.far_boxes),
            near.original_boxes(boxes.near_boxes),
            boxes.similarity,
        ),
        excluded=None
        if excluded is None
        else Excluded(
            excluded.matches,
            far.original_boxes(excluded.far_box[np.newaxis])[0],
            near.original_boxes(excluded.near_box[np.newaxis])[0],
        ),
        alternatives=tuple(
            replace(each, far_from_near=_homography(each.far_from_near, far, near))
            for each in found.alternatives
        ),
        candidates=tuple(
            replace(each, far_from_near=_homography(each.far_from_near, far, near))
            for each in found.candidates
        ),
        far=infos[0],
        near=infos[1],
        intrinsics=known,
        expected_error=_with_original_hull(found.expected_error, near),
    )


def _with_original_hull(error: ExpectedError | None, near: View) -> ExpectedError | None:
    """Return an expected error whose hull of inliers is in pixels of the original near image."""
    if error is None or error.region is None:
        return error
    hull = near.original(error.region.hull)
    seen = np.isfinite(hull).all(axis=1)
    return replace(error, region=replace(error.region, hull=hull[seen]))


UNKNOWN = Intrinsics(None, None)


def undistorted(found: Localization, images: ImagePair) -> tuple[Localization, ImagePair]:
    """Return a localization and its images without distortion, as pictures show them.

    Args:
        found: a localization; without distortion it is returned as it is.
        images: its images.
    """
    known = found.intrinsics
    if known is None or not known.distorted:
        return found, images
    far, near = view_of(images.far, known.far), view_of(images.near, known.near)
    model, outline = found.far_from_near, None
    if isinstance(model, np.ndarray):
        frames = (np.linalg.inv(far.undistorted_from_frame), near.undistorted_from_frame)
        model = _between(frames, model, found.model)
        if found.model == "homography":
            outline = footprint(model, near.image.width, near.image.height)
    points = found.points
    far_xy, near_xy = far.frame(points.far), near.frame(points.near)
    seen = np.isfinite(np.hstack([far_xy, near_xy])).all(axis=1)
    shown = replace(
        found,
        far_from_near=model,
        footprint=outline,
        points=PointMatches(far_xy[seen], near_xy[seen], points.inliers[seen]),
        landmarks=LandmarkMatches(
            far.frame_boxes(found.landmarks.far_boxes),
            near.frame_boxes(found.landmarks.near_boxes),
            found.landmarks.similarity,
        ),
        far=far.image.info,
        near=near.image.info,
        intrinsics=None,
    )
    return shown, ImagePair(far.image, near.image)


def outline_in_far(
    far_from_near: Matrix3, known: Intrinsics, width: int, height: int
) -> Coordinates | None:
    """Return the outline of the near image in the far image, through both lenses.

    Args:
        far_from_near: homography between undistorted pixels.
        known: both cameras; None for one that has no distortion.
        width: width of the near image in pixels.
        height: height of the near image in pixels.

    Returns:
        (N, 2) far pixels, clockwise from the near image's top left corner: the four corners, or
        64 points where a lens distorts. None where the horizon crosses the near image, or a part
        lies where the far lens shows nothing.
    """
    if not known.distorted:
        return footprint(far_from_near, width, height)
    camera = known.near if known.near is not None else CameraIntrinsics(1.0, 1.0, 0.0, 0.0)
    border = undistorted_outline(camera, width, height)
    depth = np.column_stack([border, np.ones(len(border))]) @ far_from_near[2]
    if not ((depth > 0).all() or (depth < 0).all()):
        return None
    mapped = transform(far_from_near, border)
    if known.far is not None:
        mapped = known.far.distorted(mapped)
    return mapped if np.isfinite(mapped).all() else None


def _moved(
    model: Matrix3 | RelativePose | None, kind: ModelKind, far: View, near: View
) -> Matrix3 | RelativePose | None:
    """Return a model between frames as one between undistorted pixels."""
    if model is None or isinstance(model, RelativePose):
        return model
    frames = (far.undistorted_from_frame, np.linalg.inv(near.undistorted_from_frame))
    return _between(frames, model, kind)


def _homography(model: Matrix3, far: View, near: View) -> Matrix3:
    frames = (far.undistorted_from_frame, np.linalg.inv(near.undistorted_from_frame))
    return _between(frames, model, "homography")


def _between(frames: tuple[Matrix3, Matrix3], model: Matrix3, kind: ModelKind) -> Matrix3:
    """Return a homography or fundamental matrix between other pixels."""
    left, right = frames
    if kind == "homography":
        return normalized(left @ model @ right)
    moved = np.linalg.inv(left).T @ model @ right
    return np.asarray(moved / np.linalg.norm(moved))
