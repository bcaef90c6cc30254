"""Localizations as they are kept: of a job, and as a row of benchmark results."""

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from nearfar.app.files import write_whole
from nearfar.errors import ExportError, LocalizationError
from nearfar.exports.subject import ImageNames
from nearfar.geometry.homography import footprint
from nearfar.imaging.image import ImageInfo
from nearfar.localization import Localization, PointMatches

_OF_A_ROW = (
    "reason", "model", "far_from_near", "scale_change", "confidence", "log10_nfa",
    "method", "step", "descriptor",
)  # fmt: skip
"""What `Localization.to_dict` and a row of results have in common, besides the status."""


def kept_localization(content: Any) -> Localization:
    """Return the localization that `Localization.to_dict` has written, without its matches.

    Raises:
        LocalizationError: the content is damaged.
    """
    try:
        return Localization.from_dict(content)
    except LocalizationError:
        raise LocalizationError("what was kept of this answer is damaged") from None


def localization_of_row(row: Mapping[str, Any], far: ImageInfo, near: ImageInfo) -> Localization:
    """Return the localization that a row of benchmark results tells of, without its matches.

    Raises:
        LocalizationError: the row is damaged.
    """
    content = {name: row.get(name) for name in _OF_A_ROW}
    localized = row.get("status") == "localized" and content["far_from_near"] is not None
    content |= {"status": "localized" if localized else "failed", "seconds": {}, "footprint": None}
    if not localized:
        content["far_from_near"] = None
    for role, image in (("far", far), ("near", near)):
        content[role] = {"path": None, "width": image.width, "height": image.height}
    found = replace(kept_localization(content), far=far, near=near)
    if found.model != "homography" or found.far_from_near is None:
        return found
    model = np.asarray(found.far_from_near)
    return replace(found, footprint=footprint(model, near.width, near.height))


@dataclass(frozen=True, eq=False)
class KeptAnswer:
    """A localization that was kept.

    Attributes:
        localization: the answer, without its matches.
        matches: file of its matched points; None where they were not kept.
        names: of the images in files that name them.
    """

    localization: Localization
    matches: Path | None
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
