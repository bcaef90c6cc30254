"""The row of a result file for one case and one localizer."""

import errno

from nearfar.bench.cases import Case
from nearfar.bench.evaluate import evaluate, failure_columns
from nearfar.bench.rows import Row
from nearfar.errors import NearfarError
from nearfar.localizer import Localizer
from nearfar.settings import Settings

_KEPT = (
    "status",
    "reason",
    "far_from_near",
    "inliers",
    "matches",
    "landmark_matches",
    "scale_change",
    "log10_false_alarms",
    "confidence",
    "step",
    "seconds",
)


def identity(case: Case, settings: Settings, key: str, descriptor: str | None) -> Row:
    """What a row says about its case and method before anything is computed.

    Args:
        case: the case.
        settings: the method and its settings.
        key: hash of the settings, from `settings_key`.
        descriptor: name of the landmark descriptor; None for a method without landmarks.
    """
    return {
        "case": case.name,
        "group": case.group,
        "tags": dict(case.tags),
        "far": str(case.far),
        "near": str(case.near),
        "model": case.model,
        "true_scale_change": case.scale_change,
        "method": settings.method,
        "descriptor": descriptor,
        "settings": key,
    }


def localized_row(case: Case, localizer: Localizer, key: str) -> Row:
    """Localize a case and compare with its truth.

    Whatever goes wrong with one case is recorded in its row, so that a run goes on; a full disk
    is not the case's fault and ends the run.

    Args:
        case: the case.
        localizer: the method.
        key: hash of its settings, from `settings_key`.

    Raises:
        OSError: the disk is full.
    """
    row = identity(case, localizer.settings, key, localizer.descriptor)
    try:
        found = localizer.localize(
            case.far, case.near, model=case.model, intrinsics=case.intrinsics
        )
        answer, errors = found.to_dict(), evaluate(case, found)
    except NearfarError as error:
        return row | {"status": "error", "reason": str(error)} | failure_columns(case)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        reason = f"{type(error).__name__}: {error}"
        return row | {"status": "error", "reason": reason} | failure_columns(case)
    return row | {name: answer[name] for name in _KEPT} | errors


def died_row(case: Case, settings: Settings, key: str, descriptor: str | None) -> Row:
    """The row of a case that killed its worker; arguments as those of `identity`."""
    reason = "the process that localized it died"
    row = identity(case, settings, key, descriptor)
    return row | {"status": "error", "reason": reason} | failure_columns(case)
