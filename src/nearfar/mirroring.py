"""Near images that are mirrored: slides turned over, and pictures through a telescope."""

import dataclasses
from typing import TypeVar

import numpy as np

from nearfar.arrays import Boxes, Coordinates, Matrix3
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, normalized
from nearfar.imaging.image import Image
from nearfar.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches
from nearfar.models import Alternative, Candidate

HINT = "the mirrored near image matches: if it is turned over, allow it (--allow-mirrored)"
"""What the reason of a failure says where mirroring the near image would help."""

_Place = TypeVar("_Place", Alternative, Candidate)


def mirrored(image: Image) -> Image:
    """Return an image with left and right exchanged."""
    pixels = np.ascontiguousarray(image.pixels[:, ::-1])
    pixels.flags.writeable = False  # As in `read_image`.
    mask = None if image.mask is None else np.ascontiguousarray(image.mask[:, ::-1])
    return dataclasses.replace(image, pixels=pixels, mask=mask)


def of_the_original(found: Localization) -> Localization:
    """Convert an answer for the mirrored near image to one for the near image itself.

    Args:
        found: a homography or a fundamental matrix for `mirrored` of the near image.

    Returns:
        The answer in pixels of the near image as displayed; `far_from_near` mirrors.
    """
    width = found.near.width
    flip = np.array([[-1.0, 0, width - 1], [0, 1, 0], [0, 0, 1]])
    model, outline = found.far_from_near, None
    if model is not None and not isinstance(model, RelativePose):
        model = model @ flip
        if found.model == "homography":
            model = normalized(model)
            outline = footprint(model, width, found.near.height)
    points = found.points
    excluded = found.excluded
    if excluded is not None:
        box = _boxes(excluded.near_box[np.newaxis], width)[0]
        excluded = dataclasses.replace(excluded, near_box=box)
    return dataclasses.replace(
        found,
        mirrored=True,
        far_from_near=model,
        footprint=outline,
        points=PointMatches(points.far, _points(points.near, width), points.inliers),
        landmarks=LandmarkMatches(
            found.landmarks.far_boxes,
            _boxes(found.landmarks.near_boxes, width),
            found.landmarks.similarity,
        ),
        excluded=excluded,
        alternatives=tuple(_place(each, flip) for each in found.alternatives),
        candidates=tuple(_place(each, flip) for each in found.candidates),
    )


def with_hint(found: Localization) -> Localization:
    """Return a failure whose reason says that the mirrored near image matches."""
    return dataclasses.replace(found, reason=f"{found.reason}; {HINT}")


def _place(place: _Place, flip: Matrix3) -> _Place:
    return dataclasses.replace(place, far_from_near=normalized(place.far_from_near @ flip))


def _points(xy: Coordinates, width: int) -> Coordinates:
    return np.column_stack([width - 1 - xy[:, 0], xy[:, 1]])


def _boxes(boxes: Boxes, width: int) -> Boxes:
    """Mirror (N, 4) boxes x, y, width, height."""
    found = boxes.copy()
    found[:, 0] = width - boxes[:, 0] - boxes[:, 2]
    return found
