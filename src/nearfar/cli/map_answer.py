"""The best answer for a query of a map as a localization to export."""

from dataclasses import replace
from pathlib import Path

from nearfar.exports.subject import Subject
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.image import ImageInfo
from nearfar.landmarks import NO_LANDMARKS
from nearfar.maps.answers import MapLocalization
from nearfar.maps.files import file_of
from nearfar.maps.map import Map
from nearfar.verification.expected_error import ExpectedError


def best_answer(
    found: MapLocalization, map_: Map, camera: CameraIntrinsics | None = None
) -> Subject | None:
    """Return the best answer as a localization in the whole map image.

    Args:
        found: what the map answered; its query is the near image.
        map_: the map.
        camera: camera of the query, as it was given to `Map.locate`; None where it is not known.

    Returns:
        The localization, without pixels; None where there is no answer.
    """
    if not found.answers:
        return None
    answer = found.answers[0]
    image = next(each for each in map_.images if each.name == answer.image)
    file = file_of(answer.image, map_.folder)
    near = found.query if isinstance(found.query, Path) else None
    size = found.width, found.height
    error = answer.expected_error
    posed = isinstance(answer.far_from_near, RelativePose)
    known = None if camera is None else Intrinsics(None, camera.of_size(*size, "query"))
    localization = replace(
        answer.localization,
        far_from_near=answer.far_from_near,
        footprint=answer.footprint,
        scale_change=answer.scale_change,
        confidence=answer.confidence,
        points=answer.points,
        landmarks=NO_LANDMARKS,
        alternatives=answer.alternatives,
        candidates=(),
        excluded=None,
        far=ImageInfo(
            file if isinstance(file, Path) else None,
            image.width,
            image.height,
            (image.width, image.height),
        ),
        near=ImageInfo(near, *size, size),
        intrinsics=known,
        expected_error=None if posed or error is None else ExpectedError(mean=error),
    )
    return Subject(localization)
