"""Pairs in the authors' layout and as sequences with homographies, and the paper's size."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.studies.pairs import PAPER_SIZE, resized_to_paper
from nearfar.errors import BenchmarkError
from nearfar.geometry.errors import transfer_errors
from nearfar.geometry.homography import scale_change
from nearfar.imaging.image import read_image

HALF = np.array([[0.5, 0, 20.25], [0, 0.5, 10.25], [0, 0, 1.0]])
"""Maps the photograph to its copy at half the size, moved by (20.5, 10.5)."""


def save(path: Path, pixels: RGBPixels) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    PillowImage.fromarray(pixels).save(path)


@pytest.fixture
def images(photograph: Callable[[str], RGBPixels]) -> tuple[RGBPixels, RGBPixels]:
    near = photograph("coffee")
    return cv2.warpAffine(cv2.GaussianBlur(near, (0, 0), 1), HALF[:2], (400, 300)), near


def test_authors_layout(tmp_path: Path, images: tuple[RGBPixels, RGBPixels]) -> None:
    pytest.importorskip("yaml")
    far, near = images
    scene = tmp_path / "house"
    save(scene / "2.png", far)
    save(scene / "1.png", near)
    near_points = np.array([[0, 0], [599, 0], [599, 399], [100, 300.0]])
    far_points = near_points @ HALF[:2, :2].T + HALF[:2, 2]
    shares = {
        "1": ((near_points + 0.5) / (600, 400)).tolist(),
        "2": ((far_points + 0.5) / (400, 300)).tolist(),
    }
    (scene / "1_to_2.yaml").write_text(str(shares))
    (case,) = find_pairs(tmp_path)
    assert (case.name, case.group, case.model) == ("house/1_to_2", "house", "homography")
    assert (case.far.name, case.near.name) == ("2.png", "1.png")
    assert case.scale_change == pytest.approx(2)
    np.testing.assert_allclose(case.far_points, far_points, atol=1e-9)
    np.testing.assert_allclose(case.near_points, near_points, atol=1e-9)
    for other in ({"1": [[0, 0]]}, {name: points[:3] for name, points in shares.items()}):
        (scene / "1_to_2.yaml").write_text(str(other))
        with pytest.raises(BenchmarkError, match="1_to_2"):
            find_pairs(tmp_path)


def test_tags_of_tuples_and_numpy_are_read_and_no_other_is_obeyed(tmp_path: Path) -> None:
    """As `yaml.dump` writes tuples, scalars and arrays."""
    scene = tmp_path / "house"
    for name in ("1", "2"):
        save(scene / f"{name}.png", np.zeros((30, 40, 3), np.uint8))
    near = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.8], [0.1, 0.8]])
    content = {"1": near, "2": [(np.float64(x / 2), np.float32(y / 2)) for x, y in near]}
    file = scene / "1_to_2.yaml"
    file.write_text(yaml.dump(content))
    assert "python/tuple" in file.read_text()
    (case,) = find_pairs(tmp_path)
    np.testing.assert_allclose(case.near_points, near * (40, 30) - 0.5)
    np.testing.assert_allclose(case.far_points, near / 2 * (40, 30) - 0.5, atol=1e-5)
    marker = tmp_path / "called"
    for call in ("os.system", "numpy.fromfile"):
        file.write_text(f"!!python/object/apply:{call} ['touch {marker}']")
        with pytest.raises(BenchmarkError, match="cannot be read"):
            find_pairs(tmp_path)
    assert not marker.exists()


def test_a_homography_stands_for_points(
    tmp_path: Path, images: tuple[RGBPixels, RGBPixels]
) -> None:
    for name, pixels in zip(("far", "near"), images, strict=True):
        save(tmp_path / "cup" / f"{name}.png", pixels)
    pair = {"far": "far.png", "near": "near.png", "model": "homography"}
    file = tmp_path / "cup" / "pair.json"
    file.write_text(json.dumps(pair | {"homography": HALF.tolist()}))
    (case,) = find_pairs(tmp_path)
    assert len(case.near_points) == 10
    assert transfer_errors(HALF, case.far_points, case.near_points).max() < 1e-6
    assert case.scale_change == pytest.approx(2)
    corners = {"far_points": [[0, 0], [9, 0], [9, 9], [0, 9]]}
    corners["near_points"] = [[2 * x, 2 * y] for x, y in corners["far_points"]]
    file.write_text(json.dumps(pair | corners | {"homography": HALF.tolist()}))
    (marked,) = find_pairs(tmp_path)
    np.testing.assert_array_equal(marked.far_points, corners["far_points"])
    far_away = [[0.5, 0, 1e5], [0, 0.5, 10.25], [0, 0, 1]]
    wrong = [
        (pair, r"lacks far_points, near_points \(or homography\)"),
        ({"far": "far.png", "homography": HALF.tolist()}, "lacks near, model"),
        (pair | {"homography": [[1, 2], [3, 4]]}, "invertible"),
        (pair | {"homography": far_away}, "does not show"),
        (pair | {"far_points": "no", "near_points": [[0, 0]]}, "far_points must be a list"),
    ]
    for content, said in wrong:
        file.write_text(json.dumps(content))
        with pytest.raises(BenchmarkError, match=said):
            find_pairs(tmp_path)


@pytest.mark.parametrize(
    ("image", "homography", "suffix"), [("img{}", "H1to3p", "ppm"), ("{}", "H_1_3", "png")]
)
@pytest.mark.parametrize("near_first", [False, True])
def test_sequences(
    tmp_path: Path,
    images: tuple[RGBPixels, RGBPixels],
    image: str,
    homography: str,
    suffix: str,
    near_first: bool,
) -> None:
    far, near = images
    first, third, third_from_first = far, near, np.linalg.inv(HALF)
    if near_first:
        first, third, third_from_first = near, far, HALF
    folder = tmp_path / "v_cup"
    save(folder / f"{image.format(1)}.{suffix}", first)
    save(folder / f"{image.format(3)}.{suffix}", third)
    np.savetxt(folder / homography, third_from_first)
    (case,) = find_pairs(tmp_path)
    assert (case.name, case.group) == ("v_cup/1_3", "v_cup")
    assert (case.near.stem == image.format(1)) == near_first
    assert case.scale_change == pytest.approx(2)
    assert len(case.near_points) == 10
    assert transfer_errors(HALF, case.far_points, case.near_points).max() < 1e-6


def test_paper_size_keeps_positions(tmp_path: Path, images: tuple[RGBPixels, RGBPixels]) -> None:
    folder = tmp_path / "v_cup"
    save(folder / "1.png", images[0])
    save(folder / "2.png", images[1])
    np.savetxt(folder / "H_1_2", np.linalg.inv(HALF))
    cases = find_pairs(tmp_path)
    (case,) = resized_to_paper(cases, tmp_path / "out")
    for path in (case.far, case.near):
        assert read_image(path).pixels.shape[1::-1] == PAPER_SIZE
    np.testing.assert_allclose(
        (case.near_points + 0.5) / PAPER_SIZE, (cases[0].near_points + 0.5) / (600, 400)
    )
    assert case.scale_change == scale_change(case.far_points, case.near_points)
    assert case.scale_change != cases[0].scale_change


def test_paper_size_follows_the_images(tmp_path: Path, images: tuple[RGBPixels, RGBPixels]) -> None:
    folder = tmp_path / "v_cup"
    save(folder / "1.png", images[0])
    save(folder / "2.png", images[1])
    np.savetxt(folder / "H_1_2", np.linalg.inv(HALF))
    (before,) = resized_to_paper(find_pairs(tmp_path), tmp_path / "out")
    pixels = read_image(before.far).pixels
    save(folder / "1.png", 255 - images[0])
    (after,) = resized_to_paper(find_pairs(tmp_path), tmp_path / "out")
    assert after.far == before.far
    assert np.abs(read_image(after.far).pixels.astype(int) - (255 - pixels)).max() <= 1


def test_a_sequence_of_one_scale_is_a_pair_whichever_image_seems_larger(tmp_path: Path) -> None:
    """Measured between true points of its own, each order's scale change is below 1 here."""
    folder = tmp_path / "v_flat"
    for name in ("1", "2"):
        save(folder / f"{name}.png", np.zeros((480, 640, 3), np.uint8))
    turned = [[0.86498, 0.21339, 4.10772], [-0.1655, 1.11526, -26.74151], [0.00018, -0.00029, 1]]
    np.savetxt(folder / "H_1_2", turned)
    (case,) = find_pairs(tmp_path)
    assert case.scale_change == 1


@pytest.mark.parametrize("shift", [(-40, -30), (0, -30), (-40, -250), (100, 0)])
def test_true_points_of_a_sequence_spread_in_both_directions(
    tmp_path: Path, shift: tuple[int, int]
) -> None:
    folder = tmp_path / "v_flat"
    for name in ("1", "2"):
        save(folder / f"{name}.png", np.zeros((480, 640, 3), np.uint8))
    np.savetxt(folder / "H_1_2", np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]]))
    (case,) = find_pairs(tmp_path)
    assert len(np.unique(case.near_points, axis=0)) == 10
    assert np.linalg.svd(case.near_points - case.near_points.mean(axis=0))[1][1] > 100


def test_broken_sequences_are_named(tmp_path: Path, images: tuple[RGBPixels, RGBPixels]) -> None:
    folder = tmp_path / "v_cup"
    save(folder / "1.png", images[0])
    np.savetxt(folder / "H_1_2", np.eye(3))
    with pytest.raises(BenchmarkError, match="no image 2"):
        find_pairs(tmp_path)
    (folder / "H_1_2").write_text("1 2 3")
    with pytest.raises(BenchmarkError, match="H_1_2"):
        find_pairs(tmp_path)
    with pytest.raises(BenchmarkError, match="not a folder"):
        find_pairs(tmp_path / "missing")
