"""Length of a translation from stereo, on a made scene of known depth."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage
from scipy.ndimage import gaussian_filter

from nearfar import Localizer
from nearfar.bench.datasets.cases import Case, Stereo
from nearfar.bench.evaluate import (
    RELEASED_DISPARITIES,
    evaluate,
    failure_columns,
    metric_scale,
    stereo_depth,
    triangulated_depth,
)
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from tests.scenes import two_views

DEPTH, FOCAL, BASELINE = 10.0, 500.0, 0.5


def texture() -> NDArray[np.uint8]:
    noise = gaussian_filter(np.random.default_rng(0).normal(size=(400, 700)), 1.5)
    grey = (128 + 60 * noise / noise.std()).clip(0, 255).astype(np.uint8)
    return np.repeat(grey[..., np.newaxis], 3, axis=2)


def test_depth_of_a_wall() -> None:
    disparity = round(FOCAL * BASELINE / DEPTH)
    wall = texture()
    left, right = wall[:, :600], wall[:, disparity : 600 + disparity]
    inside = np.random.default_rng(1).uniform([200, 50], [550, 350], (50, 2))
    depth = stereo_depth(left, right, inside, FOCAL * BASELINE)
    np.testing.assert_allclose(depth[np.isfinite(depth)], DEPTH, rtol=0.05)
    assert np.isfinite(depth).mean() > 0.9
    flat = np.full_like(left, 90)
    assert np.isnan(stereo_depth(flat, flat, inside, FOCAL * BASELINE)).all()


def test_triangulated_depth_is_exact() -> None:
    views = two_views(np.random.default_rng(0), right=30, wrong=0)
    cameras = [
        CameraIntrinsics(m[0, 0], m[1, 1], m[0, 2], m[1, 2])
        for m in (views.far_intrinsics, views.near_intrinsics)
    ]
    depth = triangulated_depth(views.pose, views.far, views.near, *cameras)
    rays = np.column_stack([views.far, np.ones(30)]) @ np.linalg.inv(views.far_intrinsics).T
    in_near = (rays * depth[:, np.newaxis] - views.pose.translation) @ views.pose.rotation
    projected = in_near @ views.near_intrinsics.T
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], views.near, atol=1e-4)


def test_length_of_a_sideways_move(tmp_path: Path) -> None:
    """The near camera stands 1.2 m to the right of the far one, before a wall at 10 m."""
    wall, shift = texture(), round(FOCAL * 1.2 / DEPTH)
    disparity = round(FOCAL * BASELINE / DEPTH)
    views = {"far": 0, "near": shift, "right": disparity}
    for name, start in views.items():
        PillowImage.fromarray(wall[:, start : 600 + start]).save(tmp_path / f"{name}.png")
    camera = CameraIntrinsics(FOCAL, FOCAL, 299.5, 199.5)
    case = Case(
        name="wall",
        group="j=1",
        far=tmp_path / "far.png",
        near=tmp_path / "near.png",
        model="pose",
        scale_change=None,
        far_points=np.empty((0, 2)),
        near_points=np.empty((0, 2)),
        pose=RelativePose(np.eye(3), np.array([1.2, 0, 0])),
        intrinsics=Intrinsics(camera, camera),
        stereo=Stereo(tmp_path / "right.png", BASELINE),
    )
    found = Localizer(method="sift").localize(case.far, case.near, intrinsics=case.intrinsics)
    unit = RelativePose(np.eye(3), np.array([1.0, 0, 0]))
    assert metric_scale(unit, found, case) == pytest.approx(1.2, rel=0.05)
    # A depth of 10 m has a disparity of 25 pixels, which 16 disparities do not find.
    narrow = metric_scale(unit, found, case, RELEASED_DISPARITIES)
    assert narrow is None or narrow > 2
    errors = evaluate(case, found)
    assert errors["t_err_stereo"] == pytest.approx(0, abs=0.1)
    assert errors["t_err_released"] is not None
    assert errors["t_err_released"] > 0.5
    assert errors["t_err_released_length"] == pytest.approx(0, abs=0.05)
    PillowImage.fromarray(np.full((400, 600, 3), 90, np.uint8)).save(tmp_path / "right.png")
    errors = evaluate(case, found)
    assert errors["no_stereo_scale"] is True
    assert errors["t_err_released"] == 1
    assert failure_columns(case)["no_stereo_scale"] is True
