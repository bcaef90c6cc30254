"""The result of localizing one image in another."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Mask, Matrix3
from nearfar.errors import ImageError, IntrinsicsError, LocalizationError, SettingsError
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import transform
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.image import (
    Image,
    ImageInfo,
    ImagePair,
    ImageSource,
    band_numbers,
    read_image,
)
from nearfar.imaging.undistorted import SIDE_POINTS
from nearfar.landmarks import NO_LANDMARKS, LandmarkMatches
from nearfar.models import (
    FAILURE_KINDS,
    MODEL_KINDS,
    Alternative,
    Candidate,
    Excluded,
    FailureKind,
    ModelKind,
)
from nearfar.settings import Channels
from nearfar.verification.expected_error import ExpectedError


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Matched points, in pixels of the original images.

    Attributes:
        far: (N, 2).
        near: (N, 2).
        inliers: (N,) which of them agree with the model.
    """

    far: Coordinates
    near: Coordinates
    inliers: Mask

    def __len__(self) -> int:
        return len(self.far)


_DAMAGES = (KeyError, TypeError, ValueError, AttributeError)
"""What reading of damaged JSON values raises."""
NO_POINTS = PointMatches(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.bool_))


@dataclass(frozen=True, eq=False)
class Localization:
    """Where the near image lies in the far image, or the reason why it was not found.

    All coordinates are pixels of the original images as displayed. The images themselves are not
    part of it; `read_images` reads them again.

    Where a camera with distortion is known, `far_from_near` and `alternatives` hold for undistorted
    pixels: those of a pinhole camera of the same focal lengths and principal point. `map_points`
    maps pixels of the images themselves.

    Attributes:
        status: "localized" or "failed".
        reason: reason of the failure; None where it did not fail.
        failure: kind of that reason, one of `nearfar.models.FAILURE_KINDS`; None where it did not
            fail, and in results of version 0.1.0.
        model: kind of the requested model.
        far_from_near: homography (maps near pixels to far pixels), fundamental matrix
            (x_farᵀ F x_near = 0) or relative pose; None where it failed.
        scale_change: median over all pairs of inliers of their distance in the near over that in
            the far image.
        confidence: calibrated probability that the answer is right; None for a method without
            calibration.
        log10_nfa: decimal logarithm of how many models as good as this one are expected
            among matches that are all wrong, also where it was refused for that; None where none
            was found, or with too few inliers to say.
        footprint: (4, 2) outline of the near image in the far image (top left, top right, bottom
            right, bottom left of the near image). Where a camera with distortion is known, it is
            curved: (64, 2) points, 16 from each corner on. None unless the model is a homography
            with a finite outline.
        points: matched points.
        landmarks: matched landmarks, boxes in pixels of the original images.
        seconds: wall time by stage.
        method: name of the method.
        step: step that found the answer; None for a method without several steps.
        descriptor: name of the landmark descriptor; None for a method without landmarks.
        agreement: share of the near image whose features agree with the far image where the
            homography, or the inliers around, put it; the matches had no part in this evidence.
            None where it is not known.
        excluded: what was left out as an overlay that both pictures share, boxes in pixels of the
            original images; None where nothing was.
        alternatives: other places that explain the near image nearly as well, best first,
            homographies between the original images; the confidence is shared among all.
        candidates: where it failed, places that nothing confirms and that may be worth a look, best
            first, homographies between the original images.
        mirrored: whether the near image was found mirrored (`allow_mirrored`).
        far: path and size of the far image.
        near: path and size of the near image.
        intrinsics: the cameras that the images were localized with, for their sizes; None where
            none was given.
        expected_error: how far the answer is expected to be off if it is the right place, in
            pixels of the original far image, or in degrees for a pose; None where it failed, or
            where nothing can be said.
    """

    status: Literal["localized", "failed"]
    reason: str | None
    model: ModelKind
    far_from_near: Matrix3 | RelativePose | None
    scale_change: float | None
    confidence: float | None
    log10_nfa: float | None
    footprint: Coordinates | None
    points: PointMatches
    landmarks: LandmarkMatches
    seconds: dict[str, float]
    method: str
    step: str | None
    descriptor: str | None
    far: ImageInfo
    near: ImageInfo
    agreement: float | None = None
    excluded: Excluded | None = None
    alternatives: tuple[Alternative, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    failure: FailureKind | None = None
    intrinsics: Intrinsics | None = None
    expected_error: ExpectedError | None = None
    mirrored: bool = False

    @property
    def localized(self) -> bool:
        """Whether a model was found."""
        return self.status == "localized"

    def map_points(self, near: Coordinates) -> Coordinates:
        """Return the pixels of the far image at which pixels of the near image lie.

        Args:
            near: (N, 2) pixels of the near image.

        Returns:
            (N, 2) pixels of the far image, with the distortion of both lenses where the cameras
            were given; NaN where a lens shows nothing.

        Raises:
            LocalizationError: no homography was found.
        """
        if self.model != "homography" or not isinstance(self.far_from_near, np.ndarray):
            raise LocalizationError(
                "only a homography maps points: localize with the model homography"
            )
        known = self.intrinsics or Intrinsics(None, None)
        return mapped_points(self.far_from_near, known, np.asarray(near, np.float64))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of the command line's `--json`; matches are only counted in it."""
        return {
            "status": self.status,
            "reason": self.reason,
            "failure": self.failure,
            "model": self.model,
            "far_from_near": self._model_as_dict(),
            "scale_change": self.scale_change,
            "confidence": self.confidence,
            "log10_nfa": self.log10_nfa,
            "footprint": None if self.footprint is None else self.footprint.tolist(),
            "inliers": int(self.points.inliers.sum()),
            "matches": len(self.points),
            "landmark_matches": len(self.landmarks),
            "method": self.method,
            "step": self.step,
            "agreement": self.agreement,
            "mirrored": self.mirrored,
            "excluded": None if self.excluded is None else _excluded_as_dict(self.excluded),
            "alternatives": [
                {"homography": each.far_from_near.tolist(), "score": each.score}
                for each in self.alternatives
            ],
            "candidates": [_candidate_as_dict(each) for each in self.candidates],
            "expected_error": None
            if self.expected_error is None
            else self.expected_error.to_dict(),
            "descriptor": self.descriptor,
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
            "far": _image_as_dict(self.far),
            "near": _image_as_dict(self.near),
            "intrinsics": None if self.intrinsics is None else _cameras_as_dict(self.intrinsics),
        }

    @staticmethod
    def from_dict(
        content: Mapping[str, Any],
        points: PointMatches = NO_POINTS,
        landmarks: LandmarkMatches = NO_LANDMARKS,
    ) -> "Localization":
        """Return the localization that `to_dict` has written.

        The sizes of the working images are not written: they are taken to be the original ones.

        Args:
            content: what `to_dict` returned, also after a way through JSON.
            points: the matched points; `content` holds their numbers only.
            landmarks: the matched landmarks; `content` holds their number only.

        Raises:
            LocalizationError: a part is missing or malformed.
        """
        try:
            if "log10_false_alarms" in content:  # The name in version 0.1.0.
                content = {**content, "log10_nfa": content["log10_false_alarms"]}
            model = _read_model(content["far_from_near"], content["model"])
            if content["status"] != ("failed" if model is None else "localized"):
                raise ValueError(f"the status {content['status']!r} contradicts the model")
            corners = content["footprint"]
            if corners is not None and len(corners) not in (4, 4 * SIDE_POINTS):
                raise ValueError(f"an outline of {len(corners)} points")
            return Localization(
                status="failed" if model is None else "localized",
                reason=_text(content["reason"]),
                model=content["model"],
                far_from_near=model,
                scale_change=_number(content["scale_change"]),
                confidence=_number(content["confidence"]),
                log10_nfa=_number(content["log10_nfa"]),
                footprint=None if corners is None else _array(corners, (len(corners), 2)),
                points=points,
                landmarks=landmarks,
                seconds={stage: float(value) for stage, value in content["seconds"].items()},
                method=str(content["method"]),
                step=_text(content["step"]),
                descriptor=_text(content["descriptor"]),
                far=_read_info(content["far"]),
                near=_read_info(content["near"]),
                agreement=_number(content.get("agreement")),
                excluded=_read_excluded(content.get("excluded")),
                alternatives=tuple(
                    Alternative(_array(each["homography"], (3, 3)), float(each["score"]))
                    for each in content.get("alternatives", ())
                ),
                candidates=tuple(_read_candidate(each) for each in content.get("candidates", ())),
                mirrored=bool(content.get("mirrored", False)),
                failure=_read_failure(content.get("failure")),
                intrinsics=_read_cameras(content.get("intrinsics")),
                expected_error=ExpectedError.from_dict(content.get("expected_error")),
            )
        except (*_DAMAGES, IntrinsicsError, SettingsError) as error:
            raise LocalizationError(
                f"this is no localization as `Localization.to_dict` writes it: {error!r}"
            ) from None

    def to_json(self) -> str:
        """Return `to_dict` as one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)

    def _model_as_dict(self) -> dict[str, Any] | None:
        if self.far_from_near is None:
            return None
        if isinstance(self.far_from_near, RelativePose):
            covariance = self.far_from_near.covariance
            return {
                "rotation": self.far_from_near.rotation.tolist(),
                "translation": self.far_from_near.translation.tolist(),
                "covariance": None if covariance is None else covariance.tolist(),
            }
        return {self.model: np.asarray(self.far_from_near).tolist()}


def mapped_points(far_from_near: Matrix3, known: Intrinsics, near: Coordinates) -> Coordinates:
    """Return the (N, 2) far pixels of (N, 2) near pixels through both lenses; NaN where none.

    Args:
        far_from_near: homography between undistorted pixels.
        known: both cameras; None for one that has no distortion.
        near: pixels of the near image.
    """
    undistorted = near if known.near is None else known.near.undistorted(near)
    mapped = transform(far_from_near, undistorted)
    return mapped if known.far is None else known.far.distorted(mapped)


def read_images(
    localization: Localization, images: Sequence[ImageSource] | None = None
) -> ImagePair:
    """Read the images of a localization again, at their working sizes and with their bands.

    Args:
        localization: what was found.
        images: the far and the near image, as they were given to `localize`; where None, they are
            read from their files.

    Raises:
        ImageError: an image was given as an array, or is missing or of another size now.
    """
    infos = localization.far, localization.near
    sources = (None, None) if images is None else images
    far, near = (read_again(*each) for each in zip(infos, sources, strict=True))
    return ImagePair(far, near)


def read_again(info: ImageInfo, source: ImageSource | None = None, *, full: bool = False) -> Image:
    """Read one image of a localization again.

    Args:
        info: its path and sizes.
        source: the image as it was given to `localize`; None to read it from its path.
        full: whether to read it in its original size, not in its working size.

    Raises:
        ImageError: it was given as an array, or is missing or of another size now.
    """
    if source is None:
        source = info.path
    if source is None:
        raise ImageError("an image that was localized as an array is needed again: give images=")
    image = read_image(
        source,
        max_size=0 if full else max(info.working_size),
        max_pixels=info.width * info.height,
        bands=info.bands,
        channels=info.channels,
    )
    if (image.width, image.height) != (info.width, info.height):
        raise ImageError(
            f"{info.path or 'the array'} has {image.width}x{image.height} pixels, but "
            f"{info.width}x{info.height} were localized: localize again"
        )
    return image


def _excluded_as_dict(excluded: Excluded) -> dict[str, Any]:
    return {
        "matches": excluded.matches,
        "far_box": excluded.far_box.tolist(),
        "near_box": excluded.near_box.tolist(),
    }


def _read_excluded(content: Mapping[str, Any] | None) -> Excluded | None:
    if content is None:
        return None
    boxes = [_array(content[name], (4,)).astype(np.int32) for name in ("far_box", "near_box")]
    return Excluded(int(content["matches"]), boxes[0], boxes[1])


def _candidate_as_dict(candidate: Candidate) -> dict[str, Any]:
    return {
        "homography": candidate.far_from_near.tolist(),
        "score": candidate.score,
        "source": candidate.source,
    }


def _read_candidate(content: Mapping[str, Any]) -> Candidate:
    model = _array(content["homography"], (3, 3))
    return Candidate(model, _number(content["score"]), str(content["source"]))


def _read_failure(content: Any) -> FailureKind | None:
    if content is not None and content not in FAILURE_KINDS:
        raise ValueError(f"the failure {content!r}")
    return cast("FailureKind | None", content)


def _cameras_as_dict(cameras: Intrinsics) -> dict[str, Any]:
    return {
        name: None if camera is None else camera.to_dict()
        for name, camera in (("far", cameras.far), ("near", cameras.near))
    }


def _read_cameras(content: Mapping[str, Any] | None) -> Intrinsics | None:
    if content is None:
        return None
    cameras = (content["far"], content["near"])
    far, near = (None if each is None else CameraIntrinsics.from_dict(each) for each in cameras)
    return Intrinsics(far, near)


def _image_as_dict(image: ImageInfo) -> dict[str, Any]:
    path = None if image.path is None else str(image.path)
    return {
        "path": path,
        "width": image.width,
        "height": image.height,
        "bands": list(image.bands),
        "channels": image.channels,
    }


def _read_info(content: Mapping[str, Any]) -> ImageInfo:
    path, width, height = _text(content["path"]), content["width"], content["height"]
    if not all(type(side) is int and side > 0 for side in (width, height)):
        raise ValueError(f"an image of {width!r} x {height!r} pixels")
    bands, channels = band_numbers(content.get("bands", ())), content.get("channels", "rgb")
    if channels not in get_args(Channels):
        raise ValueError(f"the order of channels {channels!r}")
    size = width, height
    return ImageInfo(None if path is None else Path(path), width, height, size, bands, channels)


def _read_model(content: Mapping[str, Any] | None, kind: Any) -> Matrix3 | RelativePose | None:
    if kind not in MODEL_KINDS:
        raise ValueError(f"the model {kind!r}")
    if content is None:
        return None
    if kind == "pose":
        translation = _array(content["translation"], (3,))
        covariance = content.get("covariance")
        return RelativePose(
            _array(content["rotation"], (3, 3)),
            translation,
            None if covariance is None else _array(covariance, (6, 6)),
        )
    return _array(content[kind], (3, 3))


def _array(content: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.asarray(content, np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{shape} finite numbers are needed, not {content!r}")
    return array


def _number(content: Any) -> float | None:
    if content is None:
        return None
    if isinstance(content, bool | str) or not math.isfinite(content):
        raise ValueError(f"a finite number is needed, not {content!r}")
    return float(content)


def _text(content: Any) -> str | None:
    if content is not None and not isinstance(content, str):
        raise ValueError(f"a text is needed, not {content!r}")
    return content
