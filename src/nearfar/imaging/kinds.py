"""Kinds of files by their first bytes, to say what a file is that cannot be read."""

from pathlib import Path

VIDEO_SUFFIXES = frozenset(
    [".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".webm", ".wmv"]
)
"""Suffixes of video files."""
HEIF_SUFFIXES = frozenset([".heic", ".heics", ".heif", ".heifs", ".hif"])
_RAW_SUFFIXES = frozenset(
    [".3fr", ".arw", ".cr2", ".cr3", ".dng", ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".srw"]
)
_HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_AVIF_BRANDS = (b"avif", b"avis")
_AS_IMAGE = "convert it to PNG, TIFF or JPEG first"
_AS_FRAMES = (
    "a video: give it to `nearfar map build` or `nearfar map locate` with --fps, or take a frame "
    "with nearfar.imaging.video"
)
_STARTS = (
    (b"GIF8", f"a GIF: {_AS_IMAGE}"),
    (b"%PDF", f"a PDF: {_AS_IMAGE}"),
    (b"%!PS", f"PostScript: {_AS_IMAGE}"),
    (b"8BPS", f"a Photoshop file: {_AS_IMAGE}"),
    (b"<svg", f"an SVG drawing: {_AS_IMAGE}"),
    (b"SIMPLE  =", f"a FITS file: {_AS_IMAGE}"),
    (b"v/1\x01", f"an OpenEXR image: {_AS_IMAGE}"),
    (b"#?RADIANCE", f"a Radiance HDR image: {_AS_IMAGE}"),
    (b"\xff\x0a", f"a JPEG XL image: {_AS_IMAGE}"),
    (b"\0\0\0\x0cJXL ", f"a JPEG XL image: {_AS_IMAGE}"),
    (b"\x89HDF", f"an HDF5 or NetCDF file: {_AS_IMAGE} (gdal_translate)"),
    (b"CDF", f"a NetCDF file: {_AS_IMAGE} (gdal_translate)"),
    (b"NITF", f"a NITF file: {_AS_IMAGE} (gdal_translate)"),
    (b"msid", f"a MrSID file: {_AS_IMAGE} (gdal_translate)"),
    (b"\0\0\x01\0", f"an icon: {_AS_IMAGE}"),
    (b"DDS ", f"a DDS texture: {_AS_IMAGE}"),
    (b"PK\x03\x04", "a ZIP archive: unpack it first"),
    (b"\x1a\x45\xdf\xa3", _AS_FRAMES),
)


def is_heif(start: bytes) -> bool:
    """Return whether a file that starts so is a HEIC or another HEIF image."""
    if start[4:8] != b"ftyp":
        return False
    return start[8:12] in _HEIF_BRANDS and not _is_avif(start)


def is_video_name(file: Path) -> bool:
    """Return whether a file is a video by its suffix."""
    return file.suffix.lower() in VIDEO_SUFFIXES


def foreign_kind(file: Path, start: bytes) -> str | None:
    """Return what a file is that is no image nearfar reads, and the way out; None if unknown.

    Args:
        file: its name; raw photographs are known by their suffix alone.
        start: its first bytes.
    """
    if file.suffix.lower() in _RAW_SUFFIXES:
        return "a raw photograph: develop it to TIFF, PNG or JPEG first"
    if start[4:8] == b"ftyp" and not is_heif(start) and not _is_avif(start):
        return _AS_FRAMES
    if start[:4] == b"RIFF" and start[8:12] == b"AVI ":
        return _AS_FRAMES
    if start[128:132] == b"DICM":
        return f"a DICOM file: {_AS_IMAGE}"
    return next((kind for magic, kind in _STARTS if start.startswith(magic)), None)


def _is_avif(start: bytes) -> bool:
    """Return whether the brand of a file, or one that it is compatible with, is AVIF's."""
    end = min(int.from_bytes(start[:4], "big"), 64)
    brands = {start[8:12], *(start[at : at + 4] for at in range(16, end, 4))}
    return not brands.isdisjoint(_AVIF_BRANDS)
