"""Localizations to export: a homography, a pose, and what was not found."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import CameraIntrinsics, Intrinsics, Localization, PointMatches, read_image
from tests.render.build import Shift, localized
from tests.scenes import TwoViews, two_views


@dataclass(frozen=True, eq=False)
class Posed:
    """A localization with a pose, the intrinsics of its cameras and the truth."""

    localization: Localization
    intrinsics: Intrinsics
    views: TwoViews


@pytest.fixture
def images(tmp_path: Path) -> tuple[Path, Path]:
    """Far and near: photographs/maps/far.png and photographs/near.png."""
    rng = np.random.default_rng(1)
    paths = tmp_path / "photographs" / "maps" / "far.png", tmp_path / "photographs" / "near.png"
    paths[0].parent.mkdir(parents=True)
    for path in paths:
        pixels = rng.integers(0, 255, (90, 120), np.uint8)
        PillowImage.fromarray(pixels).resize((480, 360)).save(path)
    return paths


@pytest.fixture
def found(images: tuple[Path, Path]) -> Localization:
    """By a homography, 2.5 times smaller; a point of each image is in three matches."""
    far, near = (read_image(path) for path in images)
    localization = localized(far, near, Shift(0.4, 150, 100).matrix)
    points = localization.points
    near_xy, far_xy = points.near.copy(), points.far.copy()
    near_xy[1] = near_xy[3] = near_xy[0]
    far_xy[5] = far_xy[7] = far_xy[2]
    return replace(localization, points=PointMatches(far_xy, near_xy, points.inliers))


@pytest.fixture
def failed(found: Localization) -> Localization:
    points = replace(found.points, inliers=np.zeros(len(found.points), np.bool_))
    return replace(
        found,
        status="failed",
        reason="too few matches",
        far_from_near=None,
        footprint=None,
        scale_change=None,
        points=points,
    )


@pytest.fixture
def posed(found: Localization) -> Posed:
    views = two_views(np.random.default_rng(7), right=50, wrong=10)
    points = PointMatches(views.far, views.near, np.arange(60) < views.right)
    pose = replace(found, model="pose", far_from_near=views.pose, footprint=None, points=points)
    cameras = [
        CameraIntrinsics(camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2])
        for camera in (views.far_intrinsics, views.near_intrinsics)
    ]
    return Posed(pose, Intrinsics(*cameras), views)
