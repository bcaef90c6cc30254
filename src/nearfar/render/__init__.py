"""Pictures of a localization.

`draw` and `page` hold the drawing primitives, the other modules one kind of picture each.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from nearfar.arrays import RGBPixels
from nearfar.imaging.image import ImagePair, ImageSource
from nearfar.localization import Localization, read_images
from nearfar.render.alignment import footprint_page, overlay_pages
from nearfar.render.matches import epipolar_matches, landmark_matches, point_matches
from nearfar.storage.locations import replaced
from nearfar.undistortion import undistorted

PAGES = (
    "landmark_matches", "point_matches", "epipolar_lines", "footprint",
    "blend", "checkerboard", "far_in_near_blend", "far_in_near_checkerboard",
)  # fmt: skip
"""Names of all pictures of a localization."""

_COMPRESSION = 4
"""PNG compression level; files are as small as with Pillow's 6, in half the time."""

_THINNING = 4
"""Step between the rows and columns from which 256 colours are chosen."""


def save_localization(
    localization: Localization,
    directory: str | Path,
    *,
    images: Sequence[ImageSource] | None = None,
    top: int = 1,
) -> list[Path]:
    """Write `localization.json` and pictures into a folder, which is made where missing.

    Args:
        localization: the localization to write.
        directory: the folder to write into.
        images: the far and the near image as they were given to `localize`; they are read from
            their files where None.
        top: number of places to draw: the answer and its best alternatives.

    Returns:
        The files written.

    Raises:
        ImageError: an image was an array and is not given again, or its file is gone.
        OSError: a file cannot be written.
    """
    shown = read_images(localization, images)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    report = folder / "localization.json"
    with replaced(report) as out:
        out.write_text(localization.to_json() + "\n", encoding="utf-8")
    return [report, *save_all(localization, shown, folder, top=top)]


def save_all(
    localization: Localization, images: ImagePair, folder: Path, *, top: int = 1
) -> list[Path]:
    """Write every picture that the localization allows, as PNG; others of these names are removed.

    Always `point_matches.png`; `landmark_matches.png` of a method with landmarks, unless they
    were not needed;
    `epipolar_lines.png` of a fundamental matrix; `footprint.png` of a homography that keeps the
    near image finite, and, where that meets the far image, the near image laid over the far one
    (`blend.png`, `checkerboard.png`) and the far over the near one (`far_in_near_blend.png`,
    `far_in_near_checkerboard.png`).

    Images with distortion are drawn without it.

    Args:
        localization: the localization to draw.
        images: the images of the localization.
        folder: folder to write into, which must exist.
        top: number of places to draw: the answer and its best alternatives.

    Returns:
        The files written.

    Raises:
        OSError: a file cannot be written.
    """
    localization, images = undistorted(localization, images)
    without_landmarks = localization.descriptor is None or (
        localization.step is not None and not len(localization.landmarks)
    )
    pages = {
        "landmark_matches": None if without_landmarks else landmark_matches(localization, images),
        "point_matches": point_matches(localization, images),
        "epipolar_lines": epipolar_matches(localization, images),
        "footprint": footprint_page(localization, images, top=top),
        **overlay_pages(localization, images),
    }
    for name in PAGES:  # Pictures of an earlier answer must not be left.
        if pages.get(name) is None:
            (folder / f"{name}.png").unlink(missing_ok=True)
    return [save(page, folder / f"{name}.png") for name, page in pages.items() if page is not None]


def save(pixels: RGBPixels, path: Path) -> Path:
    """Write an RGB picture as PNG.

    Raises:
        OSError: the file cannot be written.
    """
    with replaced(path) as out:
        PillowImage.fromarray(pixels).save(out, "PNG", compress_level=_COMPRESSION)
    return path


def save_small(pixels: RGBPixels, path: Path) -> Path:
    """Write an RGB picture as PNG with 256 colours, a quarter as many bytes.

    Raises:
        OSError: the file cannot be written.
    """
    picture = PillowImage.fromarray(pixels)
    thinned = PillowImage.fromarray(np.ascontiguousarray(pixels[::_THINNING, ::_THINNING]))
    palette = thinned.quantize(256, PillowImage.Quantize.MAXCOVERAGE, kmeans=2)
    picture.quantize(palette=palette, dither=PillowImage.Dither.FLOYDSTEINBERG).save(path, "PNG")
    return path
