"""Sixty kinds of image files, made from one gradient, and how each is to be read."""

import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from numpy.typing import NDArray
from PIL import Image as PillowImage
from tifffile import imwrite

from nearfar.imaging.orientation import oriented

GRADIENT = np.stack(np.broadcast_arrays(*np.ogrid[0:240:5, 0:256:4], 77), -1).astype(np.uint8)
"""(48, 64, 3), different in every pixel."""
GREY = GRADIENT[..., 0] // 2 + GRADIENT[..., 1] // 2
INFRARED = 255 - GREY
DEEP = GRADIENT.astype(np.uint16) * 257
HEIC = Path(__file__).parent / "gradient.heic"
"""`GRADIENT`, written by libheif with quality 90."""


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        name: what it is called in the test.
        suffix: of the file.
        write: writes the file.
        shown: (48, 64, 3) what is to be read; None where it is refused.
        tolerance: largest difference of a value.
        bands: see `read_image`.
        valid: (48, 64) what of it has data; None: everything.
        refusal: part of the sentence that refuses the file.
    """

    name: str
    suffix: str
    write: Callable[[Path], object]
    shown: NDArray[np.uint8] | None = None
    tolerance: float = 0
    bands: str = ""
    valid: NDArray[np.bool_] | None = None
    refusal: str = ""


def grey3(grey: NDArray[Any]) -> NDArray[np.uint8]:
    return np.repeat(grey[..., np.newaxis], 3, axis=2).astype(np.uint8)


def pillow(array: NDArray[Any], mode: str = "", **options: Any) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        image = PillowImage.fromarray(array)
        (image.convert(mode) if mode else image).save(path, **options)

    return write


def opencv(array: NDArray[Any]) -> Callable[[Path], object]:
    order = [2, 1, 0, 3]
    bgr = array if array.ndim == 2 else array[..., order[: array.shape[2]]]
    return lambda path: cv2.imwrite(str(path), bgr)


def tiff(array: NDArray[Any], **options: Any) -> Callable[[Path], object]:
    return lambda path: imwrite(path, array, **options)


def gdal(
    array: NDArray[Any],
    driver: str = "GTiff",
    mask: NDArray[np.bool_] | None = None,
    **options: Any,
) -> Callable[[Path], object]:
    """Write (height, width) or (height, width, bands) with GDAL."""
    stacked = array[np.newaxis] if array.ndim == 2 else np.moveaxis(array, -1, 0)
    count, height, width = stacked.shape
    profile = {"count": count, "height": height, "width": width, "dtype": stacked.dtype}

    def write(path: Path) -> None:
        with (
            warnings.catch_warnings(),
            rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
        ):
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(path, "w", driver=driver, **profile, **options) as out:
                out.write(stacked)
                if mask is not None:
                    out.write_mask(mask)

    return write


def content(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


def turned(array: NDArray[Any], orientation: int) -> Callable[[Path], object]:
    exif = PillowImage.Exif()
    exif[0x0112] = orientation
    return pillow(array, exif=exif, quality=100, subsampling=0)


def _encoded(mode: str, kind: str) -> bytes:
    buffer = io.BytesIO()
    PillowImage.fromarray(GRADIENT).convert(mode).save(buffer, kind)
    return buffer.getvalue()


LEFT = np.broadcast_to(np.arange(64) >= 16, (48, 64))
"""Valid pixels of the kinds whose left quarter has no data."""
ALPHA = np.dstack([GRADIENT, np.where(LEFT, 255, 0).astype(np.uint8)])
RGB_NIR = np.dstack([GRADIENT, INFRARED])
SPREAD = np.rint((GREY - GREY.min()) * (255.0 / np.ptp(GREY)))
"""What numbers without a depth are shown as: their least and largest value as 0 and 255."""
INVALID = np.where(LEFT, GREY.astype(np.int16) - 100, -9999).astype(np.int16)
KEPT = GREY[LEFT]
SPREAD_KEPT = np.rint(np.clip((GREY - float(KEPT.min())) * (255.0 / np.ptp(KEPT)), 0, 255))
DEEP_NIR = np.dstack([DEEP, INFRARED.astype(np.uint16) * 257])
CLIPPED = 5
"""Largest difference of what is scaled by percentiles, not by the least and largest value."""
FLOATS = GRADIENT.astype(np.float32) / 255
SPREAD_RGB = np.rint(GRADIENT * (255 / float(GRADIENT.max())))
DEEP_TURNED = {"extratags": [(274, "H", 1, 6, True)]}
AS_IMAGE = "convert it to PNG, TIFF or JPEG"

EIGHT_BITS = [
    Kind("jpeg", "jpg", pillow(GRADIENT, quality=100, subsampling=0), GRADIENT, 4),
    Kind("jpeg 4:2:0", "jpg", pillow(GRADIENT, quality=95), GRADIENT, 12),
    Kind("jpeg progressive", "jpg", pillow(GRADIENT, quality=100, progressive=True), GRADIENT, 9),
    Kind("jpeg grey", "jpg", pillow(GREY, quality=100), grey3(GREY), 3),
    Kind("jpeg cmyk", "jpg", pillow(GRADIENT, "CMYK", quality=100), GRADIENT, 6),
    Kind("jpeg turned 6", "jpg", turned(GRADIENT, 6), oriented(GRADIENT, 6), 4),
    Kind("jpeg mirrored 5", "jpg", turned(GRADIENT, 5), oriented(GRADIENT, 5), 4),
    Kind("jpeg bands 3,2,1", "jpg", pillow(GRADIENT, quality=100, subsampling=0),
         GRADIENT[..., ::-1], 4, bands="3,2,1"),
    Kind("png", "png", pillow(GRADIENT), GRADIENT),
    Kind("png grey", "png", pillow(GREY), grey3(GREY)),
    Kind("png bilevel", "png", pillow(GREY > 100), grey3((GREY > 100) * 255)),
    Kind("png palette", "png", pillow(GREY, "P"), grey3(GREY)),
    Kind("png alpha", "png", pillow(ALPHA), GRADIENT, valid=LEFT),
    Kind("png grey alpha", "png", pillow(ALPHA[..., [0, 3]]), grey3(GRADIENT[..., 0]), valid=LEFT),
    Kind("png turned 8", "png", turned(GRADIENT, 8), oriented(GRADIENT, 8)),
    Kind("bmp", "bmp", pillow(GRADIENT), GRADIENT),
    Kind("ppm", "ppm", pillow(GRADIENT), GRADIENT),
    Kind("webp lossless", "webp", pillow(GRADIENT, lossless=True), GRADIENT),
    Kind("webp turned 3", "webp", turned(GRADIENT, 3), oriented(GRADIENT, 3), 16),
    Kind("avif", "avif", pillow(GRADIENT, quality=100, subsampling="4:4:4"), GRADIENT, 6),
    Kind("heic", "heic", content(HEIC.read_bytes()), GRADIENT, 24),
    Kind("jpeg 2000", "jp2", pillow(GRADIENT), GRADIENT),
    Kind("jpeg 2000 grey", "jp2", pillow(GREY), grey3(GREY)),
    Kind("jpeg 2000 four bands", "jp2", gdal(RGB_NIR, "JP2OpenJPEG", QUALITY="100",
         REVERSIBLE="YES"), GRADIENT),
]  # fmt: skip
TIFFS = [
    Kind("tiff", "tif", tiff(GRADIENT, photometric="rgb"), GRADIENT),
    Kind("tiff lzw", "tif", gdal(GRADIENT, compress="LZW", predictor=2), GRADIENT),
    Kind("tiff deflate tiled", "tif",
         gdal(GRADIENT, compress="DEFLATE", tiled=True, blockxsize=16, blockysize=16), GRADIENT),
    Kind("tiff jpeg", "tif", gdal(GRADIENT, compress="JPEG", photometric="YCBCR",
         JPEG_QUALITY=100), GRADIENT, 12),
    Kind("tiff packbits", "tif", gdal(GRADIENT, compress="PACKBITS"), GRADIENT),
    Kind("tiff zstd", "tif", gdal(GRADIENT, compress="ZSTD"), GRADIENT),
    Kind("tiff lerc", "tif", gdal(GRADIENT, compress="LERC"), GRADIENT),
    Kind("tiff band by band", "tif", gdal(GRADIENT, interleave="band"), GRADIENT),
    Kind("tiff band by band lzw", "tif", gdal(GRADIENT, interleave="band", compress="LZW"),
         GRADIENT),
    Kind("tiff big-endian", "tif", tiff(GRADIENT, photometric="rgb", byteorder=">"), GRADIENT),
    Kind("bigtiff", "tif", tiff(GRADIENT, photometric="rgb", bigtiff=True), GRADIENT),
    Kind("tiff cmyk", "tif", pillow(GRADIENT, "CMYK"), GRADIENT, 1),
    Kind("tiff palette", "tif", pillow(GREY, "P"), grey3(GREY)),
    Kind("tiff alpha", "tif", tiff(ALPHA, photometric="rgb", extrasamples=["unassalpha"]),
         GRADIENT, valid=LEFT),
    Kind("tiff rgb and infrared", "tif",
         tiff(RGB_NIR, photometric="rgb", extrasamples=["unspecified"]), GRADIENT),
    Kind("tiff white is zero", "tif", tiff(GREY, photometric="miniswhite"), grey3(255 - GREY)),
    Kind("tiff five bands", "tif", gdal(np.dstack([RGB_NIR, GREY])), GRADIENT),
    Kind("tiff five bands chosen", "tif", gdal(np.dstack([RGB_NIR, GREY])),
         np.dstack([INFRARED, GRADIENT[..., :2]]), bands="4,1,2"),
    Kind("tiff one band chosen", "tif", gdal(RGB_NIR), grey3(INFRARED), bands="4"),
    Kind("tiff no-data", "tif", gdal(np.where(LEFT, GREY // 2 + 9, 0).astype(np.uint8), nodata=0),
         grey3(GREY // 2 + 9), valid=LEFT),
    Kind("tiff internal mask", "tif", gdal(GRADIENT, mask=LEFT), GRADIENT, valid=LEFT),
]  # fmt: skip
DEEPER = [
    Kind("png 16 bits", "png", opencv(DEEP), GRADIENT),
    Kind("png grey 16 bits", "png", opencv(GREY.astype(np.uint16) * 257), grey3(GREY)),
    Kind("ppm 16 bits", "ppm", opencv(DEEP), GRADIENT),
    Kind("tiff 16 bits", "tif", tiff(DEEP, photometric="rgb"), GRADIENT),
    Kind("tiff 16 bits lzw", "tif", gdal(DEEP, compress="LZW", predictor=2), GRADIENT),
    Kind("tiff 16 bits band by band", "tif",
         tiff(np.moveaxis(DEEP, -1, 0), photometric="rgb", planarconfig="separate"), GRADIENT),
    Kind("tiff 16 bits band by band deflate", "tif",
         gdal(DEEP, interleave="band", compress="DEFLATE"), GRADIENT),
    Kind("tiff 16 bits band by band turned", "tif",
         tiff(np.moveaxis(DEEP, -1, 0), photometric="rgb", planarconfig="separate",
              **DEEP_TURNED), oriented(GRADIENT, 6)),
    Kind("tiff 16 bits rgb and infrared", "tif",
         tiff(DEEP_NIR, photometric="rgb", extrasamples=["unspecified"]), GRADIENT),
    Kind("tiff 16 bits alpha", "tif",
         tiff(np.dstack([DEEP, ALPHA[..., 3].astype(np.uint16) * 257]), photometric="rgb",
              extrasamples=["unassalpha"]), GRADIENT, valid=LEFT),
    Kind("tiff 16 bits grey", "tif", tiff(GREY.astype(np.uint16) * 257), grey3(GREY)),
    Kind("tiff 16 bits white is zero", "tif",
         tiff(GREY.astype(np.uint16) * 257, photometric="miniswhite"), grey3(255 - GREY)),
    Kind("tiff 12 bits", "tif", gdal(GRADIENT.astype(np.uint16) * 16, NBITS=12), GRADIENT, 1),
    Kind("tiff 12 bits grey", "tif", gdal(GREY.astype(np.uint16) * 16, NBITS=12), grey3(GREY), 1),
    Kind("tiff int16", "tif", gdal(GREY.astype(np.int16) - 100), grey3(SPREAD), CLIPPED),
    Kind("tiff int16 no-data", "tif", gdal(INVALID, nodata=-9999), grey3(SPREAD_KEPT), CLIPPED,
         valid=LEFT),
    Kind("tiff uint32", "tif", gdal(GREY.astype(np.uint32) * 10**6), grey3(SPREAD), CLIPPED),
    Kind("tiff float32", "tif", tiff(FLOATS, photometric="rgb"), SPREAD_RGB, CLIPPED),
    Kind("tiff float32 nan", "tif", gdal(np.where(LEFT, GREY, np.nan).astype(np.float32)),
         grey3(SPREAD_KEPT), CLIPPED, valid=LEFT),
    Kind("tiff float64 lerc", "tif", gdal(GREY.astype(np.float64), compress="LERC",
         MAX_Z_ERROR=0), grey3(SPREAD), CLIPPED),
    Kind("jpeg 2000 16 bits", "jp2", gdal(DEEP, "JP2OpenJPEG", QUALITY="100", REVERSIBLE="YES"),
         GRADIENT),
]  # fmt: skip
REFUSED = [
    Kind("gif", "gif", pillow(GREY), refusal=f"is a GIF: {AS_IMAGE}"),
    Kind("raw", "dng", tiff(GREY), refusal="raw photograph: develop it"),
    Kind("dng as tif", "tif", tiff(GREY, extratags=[(50706, "B", 4, (1, 4, 0, 0), True)]),
         refusal="raw sensor values: develop"),
    Kind("tiff lab", "tif", tiff(GRADIENT, photometric="cielab"), refusal="Lab values"),
    Kind("tiff cmyk 16 bits", "tif", tiff(DEEP_NIR, photometric="separated"),
         refusal="CMYK .16 bits. values: develop or convert it to RGB"),
    Kind("tiff complex", "tif", gdal(GREY.astype(np.complex64)), refusal="amplitudes"),
    Kind("tiff lacks a band", "tif", tiff(GRADIENT, photometric="rgb"), bands="4,3,2",
         refusal="has 3 bands, not 4: choose others"),
    Kind("pdf", "pdf", content(b"%PDF-1.4 of no image"), refusal="is a PDF"),
    Kind("psd", "psd", content(b"8BPS of no image"), refusal="Photoshop"),
    Kind("jpeg xl", "jxl", content(b"\xff\x0a of no image"), refusal="JPEG XL"),
    Kind("openexr", "exr", content(b"v/1\x01 of no image"), refusal="OpenEXR"),
    Kind("dicom", "dcm", content(bytes(128) + b"DICM"), refusal="DICOM"),
    Kind("video", "mp4", content(b"\0\0\0\x18ftypisom" + bytes(60)), refusal="video.*--fps"),
    Kind("text", "png", content(b"not an image"), refusal="not an image that can be read"),
    Kind("empty", "png", content(b""), refusal="not an image that can be read"),
]  # fmt: skip
KINDS = [*EIGHT_BITS, *TIFFS, *DEEPER, *REFUSED]
