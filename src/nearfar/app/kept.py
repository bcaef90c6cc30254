"""Localizations as they are kept: of a job, and as a row of benchmark results."""

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from nearfar.app.files import write_whole
from nearfar.arrays import Matrix3
from nearfar.errors import ExportError
from nearfar.exports.subject import ImageNames
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint
from nearfar.imaging.image import Image
from nearfar.landmarks.landmarks import NO_LANDMARKS
from nearfar.localization import Localization, PointMatches
from nearfar.models import ModelKind

_Number = Annotated[float, Field(allow_inf_nan=False)]
_Three = tuple[_Number, _Number, _Number]
_Matrix = tuple[_Three, _Three, _Three]


class _Part(BaseModel):
    """A part of a JSON object, the rest of which is not looked at."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class KeptModel(_Part):
    """`far_from_near` as `Localization.to_dict` writes it."""

    homography: _Matrix | None = None
    fundamental: _Matrix | None = None
    rotation: _Matrix | None = None
    translation: _Three | None = None

    @property
    def value(self) -> Matrix3 | RelativePose | None:
        """A matrix or a pose."""
        if self.rotation is not None and self.translation is not None:
            return RelativePose(np.array(self.rotation), np.array(self.translation))
        matrix = self.homography or self.fundamental
        return None if matrix is None else np.array(matrix)


class Kept(_Part):
    """What `Localization.to_dict` and a row of results have in common.

    Attributes:
        status: "error" in a row of results: it could not be tried.
        far_from_near: what was found.

    The others are those of `Localization`.
    """

    status: Literal["localized", "failed", "error"]
    reason: str | None = None
    model: ModelKind
    far_from_near: KeptModel | None = None
    scale_change: _Number | None = None
    confidence: _Number | None = None
    log10_false_alarms: _Number | None = None
    method: str
    step: str | None = None
    descriptor: str | None = None

    @staticmethod
    def of(content: Any) -> "Kept":
        """Read a JSON object.

        Raises:
            ExportError: it is none of a localization.
        """
        try:
            return Kept.model_validate(content)
        except ValidationError:
            raise ExportError("what was kept of this answer is damaged") from None

    def localization(self, points: PointMatches, far: Image, near: Image) -> Localization:
        """The localization, without its landmarks."""
        model = None if self.far_from_near is None else self.far_from_near.value
        localized = self.status == "localized" and model is not None
        outline = None
        if localized and self.model == "homography":
            outline = footprint(np.asarray(model), near.width, near.height)
        return Localization(
            status="localized" if localized else "failed",
            reason=self.reason,
            model=self.model,
            far_from_near=model if localized else None,
            scale_change=self.scale_change,
            confidence=self.confidence,
            log10_false_alarms=self.log10_false_alarms,
            footprint=outline,
            points=points,
            landmarks=NO_LANDMARKS,
            seconds={},
            method=self.method,
            step=self.step,
            descriptor=self.descriptor,
            far=far,
            near=near,
        )


@dataclass(frozen=True, eq=False)
class KeptAnswer:
    """A localization that was kept, and the files of its images.

    Attributes:
        kept: the answer.
        matches: file of its matched points; None where they were not kept.
        far: file of the far image.
        near: file of the near image.
        names: of the images in files that name them.
    """

    kept: Kept
    matches: Path | None
    far: Path
    near: Path
    names: ImageNames


def write_matches(file: Path, points: PointMatches) -> None:
    """Keep matched points, all of them and in full precision.

    Raises:
        OSError: the file cannot be written.
    """
    content = io.BytesIO()
    np.savez_compressed(content, far=points.far, near=points.near, inliers=points.inliers)
    write_whole(file, content.getvalue())


def read_matches(file: Path) -> PointMatches:
    """The matched points that were kept.

    Raises:
        ExportError: there are none.
    """
    try:
        with np.load(file) as content:
            return PointMatches(content["far"], content["near"], content["inliers"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        raise ExportError(
            "the matches of this answer were not kept: do it again to export it"
        ) from None
