"""`nearfar localize`."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from nearfar.cli.options import Flag, SettingsOptions, WeightOptions, with_weights
from nearfar.cli.status import FAILED
from nearfar.estimators import MODEL_NAMES, ModelKind
from nearfar.localization import Localization
from nearfar.localizer import Localizer
from nearfar.settings import Settings


def localize_command(
    far: Path,
    near: Path,
    /,
    *,
    model: ModelKind | None = None,
    intrinsics: Path | None = None,
    as_json: Annotated[Flag, Parameter(name="--json")] = False,
    save: Path | None = None,
    weights: WeightOptions = (),
    settings: SettingsOptions = Settings(),  # noqa: B008
) -> int:
    """Find where the image NEAR lies in the image FAR.

    Exit status: 0 localized, 3 no localization found, 2 bad input or usage.

    Args:
        far: Image that shows more of the scene, smaller.
        near: Image that shows the scene larger.
        model: What to estimate; by default a pose with --intrinsics, else a homography.
        intrinsics: JSON file {"far": [fx, fy, cx, cy], "near": [fx, fy, cx, cy]} in pixels of the
            original images, or KITTI's calib.txt.
        as_json: Print one JSON object instead of text.
        save: Folder for localization.json and pictures.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    localizer = Localizer(with_weights(settings, weights))
    found = localizer.localize(far, near, model=model, intrinsics=intrinsics)
    saved = found.save(save) if save else []
    sys.stdout.write((found.to_json() if as_json else _text(found, saved)) + "\n")
    return 0 if found.localized else FAILED


def _text(found: Localization, saved: list[Path]) -> str:
    inliers = int(found.points.inliers.sum())
    agreement = f"{inliers} of {len(found.points)} point matches agree on a "
    lines = [
        f"localized: {agreement}{MODEL_NAMES[found.model]}"
        if found.localized
        else f"failed: {found.reason}"
    ]
    if found.confidence is not None:
        decided = f", decided by {found.step}" if found.localized else ""
        lines.append(f"confidence: {found.confidence:.2f}{decided}")
    if found.scale_change is not None:
        lines.append(f"scale change: {found.scale_change:.2f}x")
    if found.footprint is not None:
        corners = "  ".join(f"({x:.1f}, {y:.1f})" for x, y in found.footprint)
        lines.append(f"outline of the near image in the far image: {corners}")
    model = found.to_dict()["far_from_near"]
    if model is not None:
        for name, value in model.items():
            lines.append(f"{name}: {value}")
    total = sum(found.seconds.values())
    stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in found.seconds.items())
    lines.append(f"{total:.2f} s ({stages})")
    lines += [f"saved {path}" for path in saved]
    return "\n".join(lines)
