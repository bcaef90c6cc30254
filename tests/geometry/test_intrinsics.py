"""Reading intrinsics, and refusing bad ones."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearfar.errors import IntrinsicsError
from nearfar.geometry.camera_files import read_camera, read_intrinsics
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics


def of_four(values: list[float]) -> CameraIntrinsics:
    fx, fy, cx, cy = values
    return CameraIntrinsics(fx, fy, cx, cy)


FAR, NEAR = [700.0, 710.0, 320.0, 240.0], [1400.0, 1410.0, 300.0, 220.0]


def test_json_file_mapping_and_object_agree(tmp_path: Path) -> None:
    file = tmp_path / "intrinsics.json"
    file.write_text(json.dumps({"far": FAR, "near": NEAR}))
    expected = Intrinsics(of_four(FAR), of_four(NEAR))
    assert read_intrinsics(file) == expected
    assert read_intrinsics({"far": FAR, "near": NEAR}) == expected
    assert read_intrinsics(expected) is expected
    np.testing.assert_array_equal(of_four(FAR).matrix, [[700, 0, 320], [0, 710, 240], [0, 0, 1]])


@pytest.mark.parametrize("first", ["P0", "P2"])
def test_kitti_calibration(tmp_path: Path, first: str) -> None:
    file = tmp_path / "calib.txt"
    file.write_text(f"{first}: 718.856 0 607.1928 0 0 718.5 185.2157 0 0 0 1 0\nTr: 1 2 3\n")
    found = read_intrinsics(file)
    assert found.far == found.near == CameraIntrinsics(718.856, 718.5, 607.1928, 185.2157)


@pytest.mark.parametrize(
    "content",
    [
        {"far": FAR},
        {"far": FAR, "near": NEAR[:3]},
        {"far": FAR, "near": "1234"[:2]},
        {"far": FAR, "near": [float("nan"), 1, 1, 1]},
        {"far": FAR, "near": [float("inf"), 1, 1, 1]},
        {"far": FAR, "near": [0, 1, 1, 1]},
        {"far": FAR, "near": [1, -1, 1, 1]},
        {"far": FAR, "near": NEAR, "other": NEAR},
        [FAR, NEAR],
        None,
    ],
)
def test_malformed_values_are_refused(tmp_path: Path, content: Any) -> None:
    file = tmp_path / "intrinsics.json"
    file.write_text(json.dumps(content))
    with pytest.raises(IntrinsicsError):
        read_intrinsics(file)


def test_a_byte_order_mark_and_the_order_of_cameras_do_not_matter(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text("P1: 9 0 9 0 0 9 9 0 0 0 1 0\nP0: 7 0 3 0 0 7 2 0 0 0 1 0\n", "utf-8-sig")
    assert read_intrinsics(file).far == CameraIntrinsics(7, 7, 3, 2)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"far": [1%s], "near": [1]}' % ("0" * 5000)])
def test_hostile_files_are_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "intrinsics.json"
    file.write_text(text)
    with pytest.raises(IntrinsicsError):
        read_intrinsics(file)


@pytest.mark.parametrize("text", ["", "{", "P0: 1 2 3", "P0 1 2 3", "P: x"])
def test_malformed_files_are_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "calib.txt"
    file.write_text(text)
    with pytest.raises(IntrinsicsError):
        read_intrinsics(file)
    with pytest.raises(IntrinsicsError, match="missing"):
        read_intrinsics(tmp_path / "missing.json")
    with pytest.raises(IntrinsicsError):
        read_intrinsics("a\0")


def test_one_camera_by_its_role(tmp_path: Path) -> None:
    far, near = of_four(FAR), of_four(NEAR)
    file = tmp_path / "cameras.json"
    file.write_text(json.dumps({"map": FAR, "query": NEAR}))
    assert (read_camera(file, "map"), read_camera(file, "query")) == (far, near)
    assert read_camera({"far": FAR, "near": NEAR}, "query") == near
    assert read_camera(far, "query") is far
    calibration = tmp_path / "calib.txt"
    calibration.write_text("P0: 700 0 320 0 0 710 240 0 0 0 1 0\n")
    assert read_camera(calibration, "map") == far
    for content in ({"map": FAR}, [1, 2, 3, 4]):
        file.write_text(json.dumps(content))
        with pytest.raises(IntrinsicsError, match='must hold {"query"'):
            read_camera(file, "query")


@pytest.mark.parametrize("camera", [[500, 500, 100, 100], "5678"])
def test_cameras_of_another_type_are_refused(camera: Any) -> None:
    with pytest.raises(IntrinsicsError):
        Intrinsics(camera, camera)
    with pytest.raises(IntrinsicsError):
        CameraIntrinsics(camera, 500, 100, 100)


def test_digits_of_a_text_are_no_camera() -> None:
    digits: Any = "5678"
    with pytest.raises(IntrinsicsError):
        read_intrinsics({"far": digits, "near": digits})
