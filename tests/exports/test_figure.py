"""Figures read by Pillow and by an XML parser."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image as PillowImage

import nearfar
from nearfar import ExportError, ImageError, Localization, read_image
from nearfar.render.draw import AGREEING, MARK
from tests.exports.conftest import Posed

pytest.importorskip("matplotlib")
SVG = "{http://www.w3.org/2000/svg}"


def test_png(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "figure.png"
    nearfar.export(found, "png", file)
    with PillowImage.open(file) as picture:
        assert picture.format == "PNG"
        assert picture.width == 2100
        assert abs(picture.info["dpi"][0] - 300) < 1
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    # The outline: the near image 2.5 times smaller at (150, 100), both images of the same size.
    scale = 2100 / (2.02 * 480)
    left, middle = round(149.8 * scale), round((100 + 0.2 * 360) * scale)
    around = pixels[middle - 4 : middle + 5, left - 4 : left + 5]
    assert np.abs(around - MARK).sum(axis=-1).min() < 60
    assert (np.abs(pixels - AGREEING).sum(axis=-1) < 60).sum() > 200
    first = file.read_bytes()
    nearfar.export(found, "png", file)
    assert file.read_bytes() == first


def test_svg_has_text_and_lines_as_such(found: Localization, tmp_path: Path) -> None:
    file = tmp_path / "figure.svg"
    nearfar.export(found, "svg", file)
    root = ET.parse(file).getroot()  # noqa: S314
    texts = ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]
    assert texts == ["far image", "near image, 2.5 times larger; 30 of 30 inliers"]
    assert len(list(root.iter(f"{SVG}image"))) == 2
    assert len(list(root.iter(f"{SVG}path"))) >= 31
    first = file.read_bytes()
    nearfar.export(found, "svg", file)
    assert file.read_bytes() == first


def test_a_pose_has_no_outline(posed: Posed, tmp_path: Path) -> None:
    file = tmp_path / "figure.png"
    nearfar.export(posed.localization, "png", file)
    with PillowImage.open(file) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert not (np.abs(pixels - MARK).sum(axis=-1) < 10).any()


def test_a_failure_is_not_drawn(failed: Localization, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="nothing to draw"):
        nearfar.export(failed, "png", tmp_path / "figure.png")


def test_images_given_as_arrays_are_given_again(
    found: Localization, images: tuple[Path, Path], tmp_path: Path
) -> None:
    far, near = (read_image(path).pixels for path in images)
    unnamed = replace(found, far=read_image(far).info, near=read_image(near).info)
    with pytest.raises(ImageError, match="give images="):
        nearfar.export(unnamed, "png", tmp_path / "unnamed.png")
    nearfar.export(unnamed, "png", tmp_path / "unnamed.png", images=(far, near))
    nearfar.export(found, "png", tmp_path / "named.png")
    assert (tmp_path / "unnamed.png").read_bytes() == (tmp_path / "named.png").read_bytes()
