"""Reading of every format, depth and orientation, and coordinates."""

import os
import threading
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image as PillowImage
from tifffile import imwrite

from nearfar.errors import ImageError, SettingsError
from nearfar.geometry.homography import outline, transform
from nearfar.imaging.decoding import quiet_pillow
from nearfar.imaging.image import Image, read_image
from nearfar.imaging.tiff import jpeg2000_header
from nearfar.imaging.tiles import reduced_size

GRADIENT = np.stack(np.broadcast_arrays(*np.ogrid[0:240:8, 0:200:5], 77), -1).astype(np.uint8)
"""(30, 40, 3), different in every pixel."""


def save(path: Path, array: NDArray[Any], **options: Any) -> Path:
    PillowImage.fromarray(array).save(path, **options)
    return path


@pytest.mark.parametrize("suffix", ["png", "tif", "bmp", "webp", "ppm", "jpg"])
def test_formats_agree(tmp_path: Path, suffix: str) -> None:
    options: dict[str, dict[str, Any]] = {
        "webp": {"lossless": True},
        "jpg": {"quality": 100, "subsampling": 0},
    }
    image = read_image(save(tmp_path / f"a.{suffix}", GRADIENT, **options.get(suffix, {})))
    assert (image.width, image.height) == (40, 30)
    tolerance = 4 if suffix == "jpg" else 0
    assert np.abs(image.pixels.astype(int) - GRADIENT).max() <= tolerance


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["png", "webp", "tif", "deep tif"])
def test_exif_orientation_is_applied(tmp_path: Path, orientation: int, kind: str) -> None:
    upright = {
        1: GRADIENT,
        2: GRADIENT[:, ::-1],
        3: GRADIENT[::-1, ::-1],
        4: GRADIENT[::-1],
        5: GRADIENT.swapaxes(0, 1),
        6: np.rot90(GRADIENT, -1),
        7: GRADIENT[::-1, ::-1].swapaxes(0, 1),
        8: np.rot90(GRADIENT),
    }
    path = tmp_path / f"a.{kind.split()[-1]}"
    if kind == "deep tif":
        stored = GRADIENT.astype(np.uint16) * 257
        imwrite(path, stored, photometric="rgb", extratags=[(274, "H", 1, orientation, True)])
    else:
        exif = PillowImage.Exif()
        exif[0x0112] = orientation
        save(path, GRADIENT, exif=exif, lossless=True)
    image = read_image(path)
    assert (image.height, image.width) == upright[orientation].shape[:2]
    np.testing.assert_array_equal(image.pixels, upright[orientation])


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("mode", ["L", "I;16", "P", "RGBA", "CMYK"])
def test_tiffs_that_pillow_would_map_are_turned_as_well(
    tmp_path: Path, orientation: int, mode: str
) -> None:
    exif = PillowImage.Exif()
    exif[0x0112] = orientation
    stored = PillowImage.fromarray(GRADIENT[..., 0]).convert("RGB" if mode in "CMYK" else "L")
    stored = stored.convert(mode)
    stored.save(tmp_path / "turned.tif", exif=exif)
    stored.save(tmp_path / "upright.tif")
    upright = read_image(tmp_path / "upright.tif").pixels
    turned = read_image(tmp_path / "turned.tif").pixels
    back = {1: 0, 2: 0, 3: 2, 4: 2, 5: 3, 6: 1, 7: 1, 8: 3}[orientation]
    turned = np.rot90(turned, back)
    if orientation in (2, 4, 5, 7):
        turned = turned[:, ::-1]
    np.testing.assert_array_equal(turned, upright)


def test_the_array_may_be_used_again() -> None:
    frame = GRADIENT.copy()
    image = read_image(frame)
    frame[:] = 0
    np.testing.assert_array_equal(image.pixels, GRADIENT)


@pytest.mark.parametrize("suffix", ["png", "tif", "ppm"])
@pytest.mark.parametrize("channels", [1, 3])
def test_sixteen_bits_equal_eight(tmp_path: Path, suffix: str, channels: int) -> None:
    eight = GRADIENT if channels == 3 else GRADIENT[..., 0]
    path = tmp_path / f"a.{'pgm' if (suffix, channels) == ('ppm', 1) else suffix}"
    deep = np.uint16(257)
    if suffix == "tif":
        imwrite(path, eight * deep)
    else:
        cv2.imwrite(str(path), np.flip(eight, 2) * deep if channels == 3 else eight * deep)
    expected = read_image(eight).pixels
    np.testing.assert_array_equal(read_image(path).pixels, expected)


def test_twelve_of_sixteen_bits_use_the_whole_range() -> None:
    sensor = np.linspace(0, 4095, 1200).astype(np.uint16).reshape(30, 40)
    pixels = read_image(sensor).pixels
    assert (pixels.min(), pixels.max()) == (0, 255)


def test_grey_palette_and_alpha(tmp_path: Path) -> None:
    grey = read_image(save(tmp_path / "grey.png", GRADIENT[..., 0])).pixels
    np.testing.assert_array_equal(grey, np.repeat(GRADIENT[..., :1], 3, axis=2))
    palette = tmp_path / "palette.png"
    PillowImage.fromarray(GRADIENT).quantize(16).save(palette)
    assert np.abs(read_image(palette).pixels.astype(int) - GRADIENT).mean() < 20
    alpha = np.dstack([GRADIENT, np.full((30, 40), 255, np.uint8)])
    alpha[:5, :, 3] = 0
    image = read_image(save(tmp_path / "alpha.png", alpha))
    pixels = image.pixels
    assert image.mask is not None
    assert not image.mask[:5].any()
    np.testing.assert_array_equal(pixels[5:], GRADIENT[5:])


def test_truncated_foreign_missing_and_folder(tmp_path: Path) -> None:
    whole = save(tmp_path / "a.jpg", np.tile(GRADIENT, (8, 8, 1)), quality=95)
    cut = tmp_path / "cut.jpg"
    cut.write_bytes(whole.read_bytes()[:2000])
    foreign = tmp_path / "text.png"
    foreign.write_text("not an image")
    empty = tmp_path / "empty.png"
    empty.touch()
    for path in (cut, foreign, empty, tmp_path / "missing.png", tmp_path):
        with pytest.raises(ImageError, match=path.name):
            read_image(path)


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_truncated_sixteen_bit_colour(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    noise = np.random.default_rng(0).integers(0, 65536, (64, 64, 3), np.uint16)
    cv2.imwrite(str(path), noise)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ImageError):
        read_image(path)


def test_damaged_exif_data_are_ignored(tmp_path: Path) -> None:
    exif = PillowImage.Exif()
    exif[0x0112] = 6
    path = save(tmp_path / "a.jpg", GRADIENT, exif=exif, quality=100, subsampling=0)
    content = path.read_bytes()
    place = content.index(b"Exif")
    path.write_bytes(content[: place + 20] + bytes(255 for _ in range(8)) + content[place + 28 :])
    assert read_image(path).pixels.shape in {(30, 40, 3), (40, 30, 3)}


def test_what_is_no_regular_file_or_path_is_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.png"
    os.mkfifo(pipe)
    with pytest.raises(ImageError, match="regular file"):
        read_image(pipe)
    with pytest.raises(ImageError, match="path or an array"):
        read_image([1, 2])  # type: ignore[arg-type]


def test_pixel_limit_can_be_raised(tmp_path: Path) -> None:
    path = save(tmp_path / "a.png", GRADIENT)
    with pytest.raises(ImageError, match="max-pixels"):
        read_image(path, max_pixels=1199)
    assert read_image(path, max_pixels=1200).width == 40
    with pytest.raises(ImageError, match="max-pixels"):
        read_image(GRADIENT, max_pixels=1199)


def test_bomb_is_refused_without_being_decoded(tmp_path: Path) -> None:
    path = tmp_path / "bomb.png"
    PillowImage.new("1", (30_000, 30_000)).save(path)
    with pytest.raises(ImageError, match="30000x30000"):
        read_image(path)


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((4, 4, 2), np.uint8),
        np.zeros(4, np.uint8),
        np.zeros((0, 4), np.uint8),
        np.zeros((4, 4), np.float32),
    ],
)
def test_unfit_arrays_are_refused(array: NDArray[Any]) -> None:
    with pytest.raises(ImageError):
        read_image(array)


@given(st.integers(1, 5000), st.integers(1, 5000), st.integers(1, 2000))
def test_corners_of_working_and_original_image_correspond(
    width: int, height: int, max_size: int
) -> None:
    working = reduced_size(width, height, max_size)
    assert max(working) <= max(max_size, 1)
    pixels = np.broadcast_to(np.uint8(0), (working[1], working[0], 3))
    image = Image(pixels, width, height, None)
    mapped = transform(image.original_from_working, outline(*working))
    np.testing.assert_allclose(mapped, outline(width, height), atol=1e-9)


def test_reduction_keeps_positions() -> None:
    rows, columns = np.ogrid[:800, :1000]
    spot = 255 * np.exp(-((columns - 620) ** 2 + (rows - 400) ** 2) / (2 * 20.0**2))
    image = read_image(spot.astype(np.uint8), max_size=250)
    weight = image.pixels[..., 0].astype(float)
    y, x = np.indices(weight.shape)
    centroid = np.array([[(x * weight).sum(), (y * weight).sum()]]) / weight.sum()
    np.testing.assert_allclose(
        transform(image.original_from_working, centroid), [[620, 400]], atol=0.05
    )


def test_what_is_transparent_is_masked_at_any_depth() -> None:
    sensor = np.full((30, 40, 4), 4095, np.uint16)
    sensor[..., 3] = 65535
    sensor[:5, :, 3] = 0
    image = read_image(sensor)
    assert image.mask is not None
    assert not image.mask[:5].any()
    assert image.mask[8:].all()
    assert (image.pixels == 255).all()


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(ImageError, match="cannot be read"):
        read_image("a" * 5000)


def test_threads_leave_pillow_and_the_warnings_as_they_were() -> None:
    before = PillowImage.MAX_IMAGE_PIXELS, list(warnings.filters)
    entered, leave = threading.Event(), threading.Event()

    def enter() -> None:
        with quiet_pillow():
            entered.set()
            leave.wait()

    other = threading.Thread(target=enter)
    with quiet_pillow():
        other.start()
        entered.wait(0.2)
    leave.set()
    other.join()
    assert (PillowImage.MAX_IMAGE_PIXELS, list(warnings.filters)) == before


def test_what_is_read_cannot_be_changed(tmp_path: Path) -> None:
    """Features that a localizer keeps refer to it."""
    pixels = np.zeros((4, 5, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    for source in (pixels, tmp_path / "a.png"):
        with pytest.raises(ValueError, match="read-only"):
            read_image(source).pixels[0] = 1
    pixels[0] = 1


def test_a_negative_size_is_refused() -> None:
    with pytest.raises(SettingsError, match="max_size"):
        read_image(np.zeros((4, 5, 3), np.uint8), max_size=-1)


def test_a_png_that_holds_the_bytes_of_a_code_stream_is_a_png() -> None:
    stream = b"\xff\x4f\xff\x51" + bytes(40) + b"\x00\x03" + bytes([7] * 9)
    assert jpeg2000_header(b"\x89PNG\r\n\x1a\n" + stream) is None
