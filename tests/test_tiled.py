"""A close-up of a panorama is found in a window of it."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar import Localizer
from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError, SettingsError
from nearfar.geometry.homography import transform
from nearfar.imaging.raster import open_raster
from nearfar.settings import Settings
from nearfar.tiled import localize_in_raster, localize_in_tiles

SETTINGS = Settings(max_size=400, max_effort="points")


@pytest.fixture(scope="module")
def panorama(photograph: Callable[[str], RGBPixels]) -> RGBPixels:
    """Photographs side by side, (300, 4800, 3)."""
    names = ("astronaut", "coffee", "chelsea", "rocket") * 3
    return np.hstack([cv2.resize(photograph(name), (400, 300)) for name in names])


def test_a_close_up_is_found_in_a_panorama(panorama: RGBPixels) -> None:
    turned = panorama.copy()
    turned[:, 2400:] = turned[::-1, 2400:]  # Each photograph is there once as it is.
    turned[:, :800] = 128
    near = cv2.resize(panorama[20:280, 1220:1480], (520, 520), interpolation=cv2.INTER_CUBIC)
    whole = Localizer(SETTINGS).localize(turned, near)
    assert not whole.localized
    assert "4800x300 to 400x25 pixels: search windows of it (--far-tiles)" in str(whole.reason)
    found = localize_in_tiles(whole, turned, near, SETTINGS)
    assert found.localized
    corners = np.array([[-0.5, -0.5], [519.5, 519.5]])
    truth = [[1219.5, 19.5], [1479.5, 279.5]]
    np.testing.assert_allclose(transform(np.asarray(found.far_from_near), corners), truth, atol=1)
    assert (found.far.width, found.far.height) == (4800, 300)
    assert found.footprint is not None
    np.testing.assert_allclose(found.footprint[0], truth[0], atol=1)
    inliers = found.points.inliers
    reprojected = transform(np.asarray(found.far_from_near), found.points.near[inliers])
    assert np.median(np.abs(reprojected - found.points.far[inliers])) < 1


def test_a_close_up_is_found_in_a_tiff_that_is_too_large(
    panorama: RGBPixels, tmp_path: Path
) -> None:
    rasterio = pytest.importorskip("rasterio")
    far = tmp_path / "far.tif"
    size = {"width": 4000, "height": 300, "count": 3, "dtype": "uint8", "crs": "EPSG:32633"}
    size |= {"transform": rasterio.Affine(0.1, 0, 5e5, 0, -0.1, 5e6)}
    with rasterio.open(far, "w", driver="GTiff", photometric="RGB", **size) as dataset:
        dataset.write(np.moveaxis(panorama[:, :4000], -1, 0))
    near = cv2.resize(panorama[20:280, 2820:3080], (520, 520), interpolation=cv2.INTER_CUBIC)
    with rasterio.open(far, "r+") as dataset:  # Each photograph is there once.
        dataset.write(np.full((3, 300, 2400), 90, np.uint8), window=((0, 300), (0, 2400)))
    localizer = Localizer(SETTINGS.replace(max_pixels=10**6))
    with pytest.raises(ImageError, match="more than the limit"):
        localizer.localize(far, near)
    found = localize_in_raster(localizer, open_raster(far), near)
    corners = np.array([[-0.5, -0.5], [519.5, 519.5]])
    truth = [[2819.5, 19.5], [3079.5, 279.5]]
    np.testing.assert_allclose(transform(np.asarray(found.far_from_near), corners), truth, atol=1)
    assert (found.far.path, found.far.width, found.far.height) == (far, 4000, 300)
    noise = np.random.default_rng(0).integers(0, 255, (200, 200, 3), np.uint8)
    with pytest.raises(SettingsError, match="--max-size must be above 0"):
        localize_in_raster(Localizer(max_size=0), open_raster(far), near)
    missed = localize_in_raster(localizer, open_raster(far), noise, model="fundamental")
    assert "window" not in str(missed.reason)


def test_what_is_in_no_window_has_failed(panorama: RGBPixels) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (200, 200, 3), np.uint8)
    whole = Localizer(SETTINGS).localize(panorama[:, :1300], noise)
    found = localize_in_tiles(whole, panorama[:, :1300], noise, SETTINGS)
    assert not found.localized
    assert "nor is it in a window" in str(found.reason)
    fundamental = Localizer(SETTINGS).localize(panorama[:, :1300], noise, model="fundamental")
    with pytest.raises(SettingsError, match="--far-tiles"):
        localize_in_tiles(fundamental, panorama, noise, SETTINGS)
    known = Localizer(SETTINGS).localize(
        panorama[:, :1300],
        noise,
        intrinsics={"far": [900, 900, 650, 150], "near": [900, 900, 100, 100]},
        model="homography",
    )
    with pytest.raises(SettingsError, match="cameras"):
        localize_in_tiles(known, panorama[:, :1300], noise, SETTINGS)
