"""Why a pair was not localized, in plain words."""

from nearfar.localization import Localization
from nearfar.settings import Settings

_FEW = 8
"""Matches below which there is nothing to judge."""


def explanation(found: Localization, settings: Settings) -> str | None:
    """What a person can make of a failure; None where there is none."""
    if found.localized:
        return None
    matches = len(found.points)
    if matches < _FEW:
        return (
            "Hardly anything in the two images looks alike. They may show different places, or one "
            "of them may be too blurred, too dark or too plain."
        )
    if found.reason is not None and "--min-confidence" in found.reason:
        return (
            "There is a place where the near image might lie, but too little speaks for it to be "
            f"trusted: the confidence is {found.confidence or 0:.0%}, and at least "
            f"{settings.min_confidence:.0%} is asked for. A near image that shows more, or a far "
            "image that is less coarse, may help."
        )
    if found.reason is not None and "--max-false-alarms" in found.reason:
        return (
            "A few spots of the two images agree on a place, but so few that it may be chance. The "
            "near image may not lie in the far one, or be shown too small there."
        )
    if found.reason is not None and "a rotation alone explains" in found.reason:
        return (
            "The camera only turned or zoomed between the two images, so that they do not tell a "
            "direction from one to the other. Ask for a homography: it is exact there."
        )
    if found.reason is not None and "leave its corners open" in found.reason:
        return (
            "Spots of the two images agree on a place, but they lie on one line or close together, "
            "so that size and tilt of the near image remain open. A near image that shows more "
            "texture beside them may help."
        )
    return (
        f"Of {matches:,} spots that look alike in the two images, no group agrees on one place. "
        "The near image may not lie in the far one, be too small there, or show the scene from "
        "too different a side."
    )


def crash_explanation(exit_status: int | None) -> str:
    """Why a job ended without an answer although nothing was wrong with the images."""
    if exit_status in (-9, 137):
        return "The process that did the work was ended from outside; memory may have run out."
    return f"The process that did the work ended unexpectedly (status {exit_status})."
