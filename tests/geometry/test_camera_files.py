"""Each format of calibrations is read as its tool means it."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from nearfar.errors import IntrinsicsError
from nearfar.geometry.camera_files import cameras_in_text, read_camera, read_intrinsics
from nearfar.geometry.intrinsics import CameraIntrinsics, lens_of

K = np.array([[1250.0, 0, 799.5], [0, 1240.0, 599.5], [0, 0, 1]])
D = [-0.11, 0.02, 0.0005, -0.0003, 0.01]
TRUTH = CameraIntrinsics(1250, 1240, 799.5, 599.5, lens_of("opencv", D), (1600, 1200))
FISHEYE = CameraIntrinsics(1250, 1240, 799.5, 599.5, lens_of("fisheye", D[:4]), (1600, 1200))


def written(file: Path, text: str) -> Path:
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("ending", ["yaml", "json"])
@pytest.mark.parametrize("fisheye", [0, 1])
def test_what_opencv_wrote(tmp_path: Path, ending: str, fisheye: int) -> None:
    file = tmp_path / f"calibration.{ending}"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1600)
    storage.write("image_height", 1200)
    storage.write("fisheye_model", fisheye)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", np.array([D[:4] if fisheye else D]))
    storage.release()
    assert read_camera(file, "query") == (FISHEYE if fisheye else TRUTH)
    assert read_intrinsics(file).both is not None


@pytest.mark.parametrize(("model", "truth"), [("plumb_bob", TRUTH), ("equidistant", FISHEYE)])
def test_camera_info_of_ros(tmp_path: Path, model: str, truth: CameraIntrinsics) -> None:
    bent = D if model == "plumb_bob" else D[:4]
    text = f"""
image_width: 1600
image_height: 1200
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: {K.ravel().tolist()}
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {len(bent)}
  data: {bent}
"""
    assert read_camera(written(tmp_path / "front.yaml", text), "query") == truth
    topic = (
        f"height: 1200\nwidth: 1600\ndistortion_model: {model}\nD: {bent}\nK: {K.ravel().tolist()}"
    )
    assert read_camera(written(tmp_path / "topic.yaml", topic), "query") == truth


def test_a_chain_of_kalibr_and_the_choice_of_a_camera(tmp_path: Path) -> None:
    part = {"camera_model": "pinhole", "intrinsics": [1250, 1240, 799.5, 599.5],
            "distortion_model": "equidistant", "distortion_coeffs": D[:4],
            "resolution": [1600, 1200]}  # fmt: skip
    file = written(tmp_path / "chain.yaml", json.dumps({"cam0": part, "cam1": part}))
    assert read_camera(f"{file}#cam1", "query") == FISHEYE
    with pytest.raises(IntrinsicsError, match="cam0, cam1: choose one"):
        read_camera(file, "query")


def test_cameras_that_colmap_wrote(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction()
    for key, name, values in ((1, "OPENCV", D[:4]), (2, "OPENCV_FISHEYE", D[:4])):
        camera = pycolmap.Camera(
            model=name, width=1600, height=1200, params=[1250, 1240, 800, 600, *values]
        )
        camera.camera_id = key
        model.add_camera(camera)
    model.write_text(tmp_path)
    file = tmp_path / "cameras.txt"
    assert read_camera(f"{file}#2", "query") == FISHEYE
    assert read_camera(f"{file}#1", "map").lens == lens_of("opencv", D[:4])
    with pytest.raises(IntrinsicsError, match="choose one"):
        read_intrinsics(file)


def test_raw_and_rectified_cameras_of_kitti(tmp_path: Path) -> None:
    text = (
        "S_00: 1600 1200\nK_00: 1250 0 799.5 0 1240 599.5 0 0 1\nD_00: "
        + " ".join(map(str, D))
        + "\nS_rect_00: 1600 1200\nP_rect_00: 1000 0 800 0 0 1000 600 0 0 0 1 0\n"
    )
    file = written(tmp_path / "calib_cam_to_cam.txt", text)
    assert read_camera(f"{file}#K_00", "query") == TRUTH
    assert read_camera(file, "query") == CameraIntrinsics(1000, 1000, 800, 600, None, (1600, 1200))


def test_text_mapping_and_json_of_a_result_agree(tmp_path: Path) -> None:
    text = "OPENCV:1250,1240,800,600,-0.11,0.02,0.0005,-0.0003"
    camera = read_camera(text, "query")
    found = read_intrinsics({"far": None, "near": text})
    assert found.far is None
    assert found.near == camera
    content = {"far": None, "near": TRUTH.to_dict()}
    file = written(tmp_path / "cameras.json", json.dumps(content))
    assert read_intrinsics(file).near == TRUTH


@pytest.mark.parametrize(
    "content",
    [
        {"camera_matrix": [1, 2, 3]},
        {"camera_matrix": K.tolist(), "distortion_coefficients": [1, 2, 3, 4, 5, 6]},
        {"camera_matrix": K.tolist(), "distortion_model": "omni"},
        {"camera_matrix": [[1, 5, 0], [0, 1, 0], [0, 0, 1]]},
        {"camera_matrix": K.tolist(), "image_size": [1]},
        {"other": 1},
    ],
)
def test_malformed_calibrations_are_refused(tmp_path: Path, content: Any) -> None:
    file = written(tmp_path / "camera.json", json.dumps(content))
    with pytest.raises(IntrinsicsError, match="camera.json"):
        read_camera(file, "query")


def test_a_text_is_read_without_opening_files(tmp_path: Path) -> None:
    for text in ("exif", " PINHOLE:1250,1240,800,600\n", "[1250, 1240, 799.5, 599.5]"):
        found = cameras_in_text(text)
        assert found.far == found.near
    assert cameras_in_text("PINHOLE:1250,1240,800,600").near == CameraIntrinsics(
        1250, 1240, 799.5, 599.5
    )
    kitti = cameras_in_text("P0: 1250 0 799.5 0 0 1240 599.5 0 0 0 1 0\n").near
    assert kitti == CameraIntrinsics(1250, 1240, 799.5, 599.5)
    assert cameras_in_text('{"far": "exif", "near": [1, 1, 2, 2]}').far == "exif"
    file = written(tmp_path / "cameras.json", "[1250, 1240, 799.5, 599.5]")
    for text in (str(file), json.dumps({"far": str(file), "near": None}), "", "[" * 19_000):
        with pytest.raises(IntrinsicsError):
            cameras_in_text(text)
