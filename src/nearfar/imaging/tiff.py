"""Headers of TIFFs and JPEG 2000 files: which decoder reads a file correctly."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL.TiffImagePlugin import ImageFileDirectory_v2

from nearfar.errors import ImageError

_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_BIG = 43
_SUBFILE, _WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC = 254, 256, 257, 258, 259, 262
_ORIENTATION, _SAMPLES, _PLANAR, _EXTRA, _FORMAT = 274, 277, 284, 338, 339
_GEO_KEYS, _NO_DATA, _DNG = 34735, 42113, 50706
"""Tags of TIFF, GeoTIFF, GDAL and DNG."""
_ONLY_GDAL = (34887, 50002, 52546)
"""Compressions that Pillow lacks: LERC and JPEG XL."""
_ALPHA = (1, 2)
"""Extra samples that are alpha; 0 is anything else, such as near infrared."""
_MASK = 4
"""Bit of the kind of a page that is the mask of the page before."""
_MOST_PAGES = 16
WHITE_IS_ZERO, RGB, CMYK = 0, 2, 5
"""Photometric interpretations."""
_FOREIGN = {
    8: "Lab",
    9: "Lab",
    10: "Lab",
    32803: "raw sensor",
    32844: "LogLuv",
    32845: "LogLuv",
    34892: "raw sensor",
}
"""Photometric interpretations whose values are no red, green and blue."""
_JP2 = b"\x00\x00\x00\x0cjP  "
"""Start of a JPEG 2000 file; files of other kinds may hold the bytes of a code stream by chance."""
_CODE_STREAM = b"\xff\x4f\xff\x51"
"""Start of a JPEG 2000 code stream, and of its first segment."""
_START = 1 << 16


@dataclass(frozen=True)
class TiffHeader:
    """The tags of the first page of a TIFF.

    Attributes:
        width: as stored, in pixels.
        height: as stored, in pixels.
        orientation: as in EXIF; 1: upright.
        georeferenced: whether it is a GeoTIFF.
        bits: bits of each sample.
        planar: whether each band is stored by itself.
        photometric: what the samples mean, as the tag says.
        unsigned: whether all samples are unsigned integers.
        compression: as the tag says.
        alpha: whether the last sample of a pixel is its transparency.
        masked: whether a value or a second page says which pixels have no data.
        raw: whether it is a raw photograph (DNG).
    """

    width: int
    height: int
    orientation: int
    georeferenced: bool
    bits: tuple[int, ...] = (8,)
    planar: bool = False
    photometric: int = RGB
    unsigned: bool = True
    compression: int = 1
    alpha: bool = False
    masked: bool = False
    raw: bool = False

    def by_tiles(self, max_pixels: int) -> bool:
        """Return whether to read a TIFF tile by tile: a GeoTIFF, or one with more pixels."""
        upright = self.orientation == 1
        return upright and (self.georeferenced or self.width * self.height > max_pixels)

    def check_upright(self, file: Path) -> None:
        """Check that a GeoTIFF's pixels lie as its georeference, which ignores the orientation.

        Raises:
            ImageError: they do not.
        """
        if self.georeferenced and self.orientation != 1:
            raise ImageError(f"{file} is a GeoTIFF that is stored turned: save it upright")

    def check_colours(self, file: Path) -> None:
        """Check that the samples are grey values, colours or a palette.

        Raises:
            ImageError: they are not, such as those of a raw photograph.
        """
        kind = "raw sensor" if self.raw else _FOREIGN.get(self.photometric)
        if self.photometric == CMYK and (max(self.bits) > 8 or self.planar):
            kind = f"CMYK ({max(self.bits)} bits)"
        if kind is not None:
            raise ImageError(
                f"{file} is a TIFF of {kind} values: develop or convert it to RGB first, as TIFF, "
                f"PNG or JPEG"
            )

    @property
    def samples(self) -> int:
        """Return the number of bands."""
        return len(self.bits)

    @property
    def deep_colour(self) -> bool:
        """Return whether a pixel holds its colour together, 16 bits each, as OpenCV reads it."""
        return self.bits in ((16,) * 3, (16,) * 4) and not self.planar and self.photometric == RGB

    @property
    def needs_gdal(self) -> bool:
        """Return whether only GDAL reads the values and what is valid of them correctly."""
        if self.masked or not self.unsigned or self.compression in _ONLY_GDAL:
            return True
        eight = max(self.bits) <= 8 and not self.planar and self.samples <= 4
        return not (eight or self.deep_colour or (self.samples == 1 and self.bits[0] <= 16))


def tiff_header(file: Path) -> TiffHeader | None:
    """Return the header of a TIFF; None for other files and those that cannot be read."""
    try:
        with file.open("rb") as content:
            start = content.read(8)
            if not is_tiff(start):
                return None
            if _BIG in start[2:4]:
                start += content.read(8)
            tags = ImageFileDirectory_v2(start)
            content.seek(tags.next)
            tags.load(content)
            return _header(tags, _has_mask_page(content, start, tags.next))
    except Exception:  # Damaged files make the parser raise whatever it likes.
        return None


def is_tiff(start: bytes) -> bool:
    """Return whether a file that starts so is a TIFF or BigTIFF."""
    return start[:4] in _MAGIC


def _header(tags: ImageFileDirectory_v2, mask_page: bool) -> TiffHeader:
    samples = int(tags.get(_SAMPLES, 1))
    bits = _numbers(tags, _BITS, 1)
    extra = _numbers(tags, _EXTRA, 0) if _EXTRA in tags else ()
    return TiffHeader(
        int(tags[_WIDTH]),
        int(tags[_HEIGHT]),
        int(tags.get(_ORIENTATION, 1)),
        _GEO_KEYS in tags,
        bits=bits if len(bits) == samples else bits[:1] * samples,
        planar=samples > 1 and int(tags.get(_PLANAR, 1)) == 2,
        photometric=int(tags.get(_PHOTOMETRIC, 1)),
        unsigned=set(_numbers(tags, _FORMAT, 1)) <= {1, 4},
        compression=int(tags.get(_COMPRESSION, 1)),
        alpha=bool(extra) and extra[-1] in _ALPHA,
        masked=_NO_DATA in tags or mask_page,
        raw=_DNG in tags,
    )


def _numbers(tags: ImageFileDirectory_v2, tag: int, default: int) -> tuple[int, ...]:
    value = tags.get(tag, default)
    return tuple(int(each) for each in (value if isinstance(value, tuple) else (value,)))


def _has_mask_page(content: Any, start: bytes, second: int) -> bool:
    """Return whether a page is a mask, from the second page on that lies at an offset."""
    tags = ImageFileDirectory_v2(start)
    tags.next = second
    seen = {0}
    for _ in range(_MOST_PAGES):
        if tags.next in seen:
            return False
        seen.add(tags.next)
        content.seek(tags.next)
        tags.load(content)
        if int(tags.get(_SUBFILE, 0)) & _MASK:
            return True
    return False


@dataclass(frozen=True)
class Jpeg2000Header:
    """What the first segment of a JPEG 2000 code stream says.

    Attributes:
        width: in pixels.
        height: in pixels.
        bits: bits of each component.
        signed: whether a component has negative values.
    """

    width: int
    height: int
    bits: tuple[int, ...]
    signed: bool

    @property
    def needs_gdal(self) -> bool:
        """Return whether Pillow cuts the values to 8 bits, or takes a fourth band for alpha."""
        shown = len(self.bits) == 1 or (len(self.bits) == 3 and max(self.bits) <= 8)
        return self.signed or max(self.bits) > 16 or not shown


def jpeg2000_header(start: bytes) -> Jpeg2000Header | None:
    """Return the header of a JPEG 2000 file from its first bytes; None where there is none."""
    if not start.startswith((_JP2, _CODE_STREAM)):
        return None
    at = start.find(_CODE_STREAM)
    if at < 0 or len(start) < at + 42:
        return None
    right, bottom, left, top = struct.unpack_from(">4I", start, at + 8)
    (count,) = struct.unpack_from(">H", start, at + 40)
    sizes = start[at + 42 : at + 42 + 3 * count : 3]
    if not sizes:
        return None
    return Jpeg2000Header(
        right - left,
        bottom - top,
        tuple((size & 127) + 1 for size in sizes),
        any(size & 128 for size in sizes),
    )


def first_bytes(file: Path) -> bytes:
    """Return the start of a file, in which the headers of all formats lie."""
    with file.open("rb") as content:
        return content.read(_START)
