"""`nearfar demo`, and that its truth is the truth."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage

from nearfar.arrays import Matrix3

pytest.importorskip("skimage")

from nearfar.demo import Scene, make_scene, true_scale_change

BLOCKED = """
import socket, sys
def refuse(*arguments, **options):
    raise AssertionError("the demo touched the network")
socket.socket.connect = refuse
from nearfar.cli import main
sys.exit(main(sys.argv[1:]))
"""


def run(code: str, *arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    environment = os.environ | {"COLUMNS": "120"}
    return subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env=environment, timeout=300,
        check=False,
    )  # fmt: skip


def test_demo(tmp_path: Path) -> None:
    result = run(BLOCKED, "demo", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert "True scale change: 5.9" in result.stdout
    rows = {line.split()[0]: line.split() for line in result.stdout.splitlines() if line.split()}
    errors = [row[row.index("px") - 1] for row in rows.values() if "px" in row]
    for method in ("sift", "paper", "objects"):
        assert rows[method][1] in ("localized", "failed")
        assert (tmp_path / "nearfar-demo" / method / "point_matches.png").is_file()
    assert min(map(float, errors)) < 3
    sizes = {}
    for name in ("far", "near", "demo"):
        with PillowImage.open(tmp_path / "nearfar-demo" / f"{name}.png") as opened:
            sizes[name] = opened.size
    assert sizes["far"] == (1200, 900)
    assert sizes["near"] == (512, 512)
    assert 1100 <= sizes["demo"][0] <= 1300
    assert (tmp_path / "nearfar-demo" / "demo.png").stat().st_size < 600_000


def test_missing_photographs_are_bad_input(tmp_path: Path) -> None:
    without = "import sys; sys.modules['skimage'] = None\n" + BLOCKED
    result = run(without, "demo", folder=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert "this needs skimage: pip install 'nearfar[demo]'" in result.stderr
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    result = run(BLOCKED, "demo", "--out", tmp_path / "taken", folder=tmp_path)
    assert result.returncode == 2
    assert "taken" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


def correlation(scene: Scene, far_from_near: Matrix3) -> float:
    """Between the far image and the near one warped into it, 4 x 4 samples a far pixel."""
    finer = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]])
    height, width = scene.far.shape[:2]
    size = (4 * width, 4 * height)
    near = cv2.cvtColor(scene.near, cv2.COLOR_RGB2GRAY).astype(np.float32)
    warped = cv2.warpPerspective(near, finer @ far_from_near, size)
    cover = cv2.warpPerspective(np.ones_like(near), finer @ far_from_near, size)
    expected, share = (
        cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA) for fine in (warped, cover)
    )
    far = cv2.cvtColor(scene.far, cv2.COLOR_RGB2GRAY)
    inside: NDArray[np.bool_] = share > 0.999
    assert inside.sum() > 5000
    return float(np.corrcoef(far[inside], expected[inside])[0, 1])


def test_the_truth_is_exact(scene: Scene) -> None:
    best = correlation(scene, scene.far_from_near)
    assert best > 0.99
    for x, y in ((2, 0), (-2, 0), (0, 2), (0, -2)):
        moved = np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]]) @ scene.far_from_near
        assert correlation(scene, moved) < best - 0.1


@pytest.mark.parametrize("axis", [0, 1])
def test_the_truth_is_exact_to_a_tenth_of_a_pixel(scene: Scene, axis: int) -> None:
    def moved(pixels: float) -> float:
        shift = np.eye(3)
        shift[axis, 2] = pixels
        return correlation(scene, shift @ scene.far_from_near)

    low, middle, high = moved(-0.5), moved(0), moved(0.5)
    peak = 0.25 * (low - high) / (low - 2 * middle + high)
    assert abs(peak) < 0.1


def test_the_scene_is_as_hard_as_it_says(scene: Scene) -> None:
    assert 5 < true_scale_change(scene) < 6.5
    tilt = scene.far_from_near / scene.far_from_near[2, 2]
    assert np.abs(tilt[2, :2]).max() * 512 > 0.01
    assert np.array_equal(scene.far, make_scene().far)
