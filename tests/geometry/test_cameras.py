"""Camera models: distortion and its inverse, other tools' formulas, other sizes of images."""

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearfar.errors import IntrinsicsError
from nearfar.geometry.calibrations import COLMAP_MODELS, colmap_camera, colmap_parameters
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics, lens_of

SIZE = (640, 480)
TERMS = (-0.12, 0.03, 0.001, -0.002, 0.004, 0.02, -0.01, 0.003)
"""Distortion of moderate lenses; that of a FOV camera is its angle."""


def parameters(model: str, focal: float = 420.0, scale: float = 1.0) -> list[float]:
    """Parameters of a camera of each model of COLMAP."""
    lengths, lens, terms = COLMAP_MODELS[model]
    scale *= 0.3 if lens == "fisheye" else 1.0
    bent = [0.8 * scale] if lens == "fov" else [scale * each for each in TERMS[:terms]]
    return [*[focal, 1.02 * focal][:lengths], 322.0, 238.5, *bent]


def grid() -> Any:
    x, y = np.meshgrid(np.linspace(0, SIZE[0] - 1, 23), np.linspace(0, SIZE[1] - 1, 17))
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("model", COLMAP_MODELS)
@settings(max_examples=15, deadline=None)
@given(focal=st.floats(400, 2000), scale=st.floats(0.05, 1))
def test_undistorting_and_distorting_return_to_the_same_pixel(
    model: str, focal: float, scale: float
) -> None:
    """Shorter lenses so bent have no ray for the pixels in the corners."""
    camera = colmap_camera(model, parameters(model, focal, scale))
    undistorted = camera.undistorted(grid())
    assert np.isfinite(undistorted).all()
    np.testing.assert_allclose(camera.distorted(undistorted), grid(), atol=1e-6)


@pytest.mark.parametrize("model", COLMAP_MODELS)
def test_pixels_are_those_of_colmap_half_a_pixel_apart(model: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    given_ = parameters(model)
    theirs = pycolmap.Camera(model=model, width=SIZE[0], height=SIZE[1], params=given_)
    ours = colmap_camera(model, given_, SIZE)
    rays = np.random.default_rng(0).uniform(-0.6, 0.6, (200, 2))
    seen = np.array(theirs.img_from_cam(np.column_stack([rays, np.ones(200)])))
    undistorted = rays * [ours.fx, ours.fy] + [ours.cx, ours.cy]
    np.testing.assert_allclose(ours.distorted(undistorted), seen - 0.5, atol=1e-9)
    np.testing.assert_allclose(ours.undistorted(seen - 0.5), undistorted, atol=1e-6)
    name, again = colmap_parameters(ours)
    back = pycolmap.Camera(model=name, width=SIZE[0], height=SIZE[1], params=again)
    same = np.array(back.img_from_cam(np.column_stack([rays, np.ones(200)])))
    np.testing.assert_allclose(same, seen, atol=1e-9)


@pytest.mark.parametrize("number", [4, 5, 8, 12, 14])
def test_pixels_are_those_of_opencv(number: int) -> None:
    coefficients = [*TERMS, 0.001, -0.002, 0.0005, 0.001, 0.01, -0.02][:number]
    camera = CameraIntrinsics(420, 430, 321, 238, lens_of("opencv", coefficients))
    undistorted = cv2.undistortImagePoints(
        grid(), camera.matrix, np.array(coefficients), None, (3, 200, 1e-12)
    ).reshape(-1, 2)
    np.testing.assert_allclose(camera.undistorted(grid()), undistorted, atol=1e-4)


def test_what_a_lens_does_not_show_has_no_pixel() -> None:
    folding = CameraIntrinsics(400, 400, 320, 240, lens_of("opencv", [-0.4, 0, 0, 0]))
    assert np.isnan(folding.distorted(np.array([[320 + 400 * 1.2, 240.0]]))).all()
    assert np.isnan(folding.undistorted(np.array([[320 + 400 * 0.9, 240.0]]))).all()
    fisheye = CameraIntrinsics(200, 200, 320, 240, lens_of("fisheye", [0] * 4))
    behind = np.array([[320 + 200 * np.pi / 2, 240.0]])
    assert np.isnan(fisheye.undistorted(behind)).all()


def test_an_image_of_another_resolution_scales_the_camera() -> None:
    camera = colmap_camera("OPENCV", parameters("OPENCV"), SIZE)
    half = camera.of_size(320, 240, "far")
    np.testing.assert_allclose(half.undistorted((grid() - 0.5) / 2),
                               (camera.undistorted(grid()) - 0.5) / 2, atol=1e-6)  # fmt: skip
    assert camera.of_size(*SIZE, "far") == camera
    for size, advice in (((480, 640), "turn it"), ((640, 400), "crop neither")):
        with pytest.raises(IntrinsicsError, match=advice):
            camera.of_size(*size, "far")


@pytest.mark.parametrize("model", COLMAP_MODELS)
def test_a_camera_is_read_from_what_it_wrote(model: str) -> None:
    camera = colmap_camera(model, parameters(model), SIZE)
    assert CameraIntrinsics.from_dict(camera.to_dict()) == camera
    with pytest.raises(IntrinsicsError, match="fx, fy"):
        CameraIntrinsics.from_dict({**camera.to_dict(), "origin": "guessed"})


def test_bad_cameras_are_refused() -> None:
    for model, values, message in (
        ("OPENCV", [1, 2, 3], "has 8 numbers"),
        ("SPHERE", [1, 2, 3], "not known"),
        ("FOV", [1, 1, 0, 0, 4.0], "between 0 and pi"),
        ("RADIAL", [400, 1, 1, float("nan"), 0], "finite"),
    ):
        with pytest.raises(IntrinsicsError, match=message):
            colmap_camera(model, values)
    with pytest.raises(IntrinsicsError, match="coefficients, not 3"):
        lens_of("opencv", [0.1, 0, 0])
    with pytest.raises(IntrinsicsError, match="no camera model"):
        colmap_parameters(CameraIntrinsics(1, 1, 0, 0, lens_of("opencv", [0.1] * 12)))
    with pytest.raises(IntrinsicsError, match="must be positive"):
        CameraIntrinsics(1, 1, 0, 0, size=(0, 5))


def test_one_known_camera_is_not_both() -> None:
    camera = CameraIntrinsics(1, 1, 0, 0)
    assert Intrinsics(None, camera).both is None
    assert Intrinsics(camera, camera).both == (camera, camera)
    assert not Intrinsics(camera, None).distorted
