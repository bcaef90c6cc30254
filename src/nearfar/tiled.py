"""Search a far image that is much larger than the working size tile by tile.

A panorama of 20,000 pixels is reduced to 8 % at the default working size, and a close-up of it is
lost. Here windows of it are searched, first large ones and then ever smaller ones.
"""

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Iterator

import numpy as np

from nearfar.arrays import Boxes, Matrix3
from nearfar.errors import SettingsError
from nearfar.geometry.homography import normalized, translation
from nearfar.imaging.image import Image, ImageInfo, ImageSource, read_image
from nearfar.imaging.mask import MaskSource, PixelMask, filled, without_border
from nearfar.imaging.raster import Raster
from nearfar.imaging.tiles import Tile, reduced_size
from nearfar.landmarks import LandmarkMatches
from nearfar.localization import Localization, PointMatches
from nearfar.localizer import Localizer
from nearfar.models import MODEL_NAMES, ModelKind
from nearfar.runtime.timing import Watcher
from nearfar.settings import Settings

OVERLAP = 0.5
"""Least overlap of neighbouring windows, as a share of their side."""
FINER = 2.0
"""Ratio of the sides of the windows of two successive levels."""


def localize_in_tiles(
    whole: Localization,
    far: ImageSource,
    near: ImageSource,
    settings: Settings | None = None,
    far_mask: MaskSource | None = None,
    near_mask: MaskSource | None = None,
) -> Localization:
    """Find the homography of a near image in windows of a far image, by their points.

    The far image is held in memory once; of the windows, features of about 1 GB are. TIFFs of any
    size are searched by `localize_in_raster`. The budget of the settings bounds the windows and the
    search of the whole image together.

    Args:
        whole: what `Localizer.localize` found in the whole far image.
        far: path or array of the image that shows more of the scene.
        near: path or array of the image that shows the scene larger.
        settings: the settings; the defaults where None. Windows are reduced to `max_size`.
        far_mask: see `Localizer.localize`.
        near_mask: see `Localizer.localize`.

    Returns:
        The localization in pixels of the whole far image; the failure for the whole image where
        no window holds the near image. Its number of false alarms counts the windows.

    Raises:
        ImageError: an image cannot be read.
        SettingsError: another model than a homography is asked for, or a camera is known.
    """
    chosen = settings or Settings()
    if whole.model != "homography":
        raise SettingsError(f"windows of FAR (--far-tiles) give no {MODEL_NAMES[whole.model]}")
    if whole.intrinsics is not None:
        raise SettingsError("windows of FAR (--far-tiles) know no cameras: leave these out")
    if whole.localized or chosen.max_size == 0 or max(_size(whole.far)) <= chosen.max_size:
        return whole
    far_image, near_image = _read(far, far_mask, chosen), _read(near, near_mask, chosen)

    def window(left: int, top: int, side: int) -> tuple[ImageSource, PixelMask | None]:
        part = np.s_[top : top + side, left : left + side]
        return np.ascontiguousarray(far_image.pixels[part]), _part(far_image, part)

    return _in_windows(whole, window, near_image, chosen)


def localize_in_raster(
    localizer: Localizer,
    raster: Raster,
    near: ImageSource,
    *,
    model: ModelKind = "homography",
    near_mask: MaskSource | None = None,
    watcher: Watcher | None = None,
) -> Localization:
    """Localize in a TIFF of any size: reduced first, then window by window, each from its file.

    One reduced window is held in memory at a time, so the file may have more pixels than
    `max_pixels`. For other models than a homography no windows are searched.

    Args:
        localizer: localizes in the reduced TIFF; its settings hold for the windows too.
        raster: the far image.
        near: path or array of the image that shows the scene larger.
        model: kind of model.
        near_mask: see `Localizer.localize`.
        watcher: is told of each stage, and of the attempts in the reduced TIFF.

    Returns:
        See `localize_in_tiles`.

    Raises:
        ImageError: an image cannot be read.
        SettingsError: the settings do not reduce images (`max_size` is 0).
    """
    chosen = localizer.settings
    if chosen.max_size == 0:
        raise SettingsError("a TIFF of any size is reduced first: --max-size must be above 0")
    everything = _image(raster, 0, 0, max(raster.width, raster.height), chosen.max_size)
    whole = localizer.localize(everything, near, model=model, near_mask=near_mask, watcher=watcher)
    if whole.localized or model != "homography" or max(_size(whole.far)) <= chosen.max_size:
        return whole
    if watcher is not None:
        watcher.on_stage("windows")

    def window(left: int, top: int, side: int) -> tuple[Image, PixelMask | None]:
        part = _image(raster, left, top, side, chosen.max_size)
        return part, part.mask

    return _in_windows(whole, window, _read(near, near_mask, chosen), chosen)


def _image(raster: Raster, left: int, top: int, side: int, max_size: int) -> Image:
    """Return a window of a TIFF, reduced, as an image of its own."""
    width, height = min(side, raster.width - left), min(side, raster.height - top)
    tile = Tile(left, top, width, height, *reduced_size(width, height, max_size))
    found = raster.read_masked(tile)
    pixels, mask = found.pixels, found.mask
    if mask is not None:
        pixels, mask = filled(pixels, mask), without_border(mask)
    return Image(pixels, width, height, raster.file, mask)


def _read(source: ImageSource, mask: MaskSource | None, settings: Settings) -> Image:
    return read_image(
        source,
        max_pixels=settings.max_pixels,
        mask=mask,
        bands=settings.bands,
        channels=settings.channels,
    )


def _in_windows(
    whole: Localization,
    window: Callable[[int, int, int], tuple[ImageSource | Image, PixelMask | None]],
    near: Image,
    settings: Settings,
) -> Localization:
    """Search windows until one holds the near image, or the budget is used up."""
    deadline = time.perf_counter() + settings.budget - sum(whole.seconds.values())
    localizer = Localizer(
        settings.replace(max_effort="points", channels="rgb", bands=""), mirror_hints=False
    )
    for number, (left, top, side) in enumerate(_windows(*_size(whole.far), settings.max_size), 2):
        if time.perf_counter() > deadline:
            break
        part, used = window(left, top, side)
        if used is not None and not used.any():
            continue
        found = localizer.localize(
            part,
            near.pixels,
            model="homography",
            far_mask=used,
            near_mask=_part(near, np.s_[:, :]),
        )
        log10_nfa = math.inf if found.log10_nfa is None else found.log10_nfa + math.log10(number)
        if found.localized and log10_nfa <= math.log10(settings.max_false_alarms):
            return _in_whole(found, (left, top), whole, log10_nfa)
    return dataclasses.replace(whole, reason=f"{whole.reason}; nor is it in a window of it")


def _size(info: ImageInfo) -> tuple[int, int]:
    return info.width, info.height


def _part(image: Image, window: tuple[slice, slice]) -> PixelMask | None:
    """Return the mask of a window of an image; None where all of the image is used."""
    return None if image.mask is None else np.ascontiguousarray(image.mask[window])


def _windows(width: int, height: int, max_size: int) -> Iterator[tuple[int, int, int]]:
    """Yield left, top and side of the windows, the largest first."""
    side = max(width, height) / FINER
    while True:
        pixels = max(max_size, round(side))
        across, down = _starts(width, pixels), _starts(height, pixels)
        yield from ((left, top, pixels) for top, left in itertools.product(down, across))
        if pixels == max_size:
            return
        side /= FINER


def _starts(length: int, side: int) -> list[int]:
    if length <= side:
        return [0]
    count = math.ceil((length - side) / (side * (1 - OVERLAP))) + 1
    found: list[int] = np.rint(np.linspace(0, length - side, count)).astype(int).tolist()
    return found


def _in_whole(
    found: Localization, corner: tuple[int, int], whole: Localization, log10_nfa: float
) -> Localization:
    """Return an answer for a window as one for the whole far image."""
    shift = translation(*corner)
    outline, excluded = found.footprint, found.excluded
    if excluded is not None:
        box = _moved(excluded.far_box[np.newaxis], corner)[0]
        excluded = dataclasses.replace(excluded, far_box=box)
    points, landmarks = found.points, found.landmarks
    return dataclasses.replace(
        found,
        far_from_near=_shifted(found.far_from_near, shift),
        footprint=None if outline is None else outline + corner,
        points=PointMatches(points.far + corner, points.near, points.inliers),
        landmarks=LandmarkMatches(
            _moved(landmarks.far_boxes, corner), landmarks.near_boxes, landmarks.similarity
        ),
        excluded=excluded,
        alternatives=tuple(
            dataclasses.replace(each, far_from_near=_shifted(each.far_from_near, shift))
            for each in found.alternatives
        ),
        log10_nfa=log10_nfa,
        far=whole.far,
        near=whole.near,
    )


def _shifted(model: object, shift: Matrix3) -> Matrix3:
    return normalized(shift @ np.asarray(model, np.float64))


def _moved(boxes: Boxes, corner: tuple[int, int]) -> Boxes:
    return boxes + np.array([*corner, 0, 0], boxes.dtype)
