"""Pictures of one image laid over the other."""

from typing import TYPE_CHECKING

from nearfar.arrays import RGBPixels
from nearfar.pictures.alignment import Overlay, far_on_near, near_on_far
from nearfar.pictures.draw import MARK, WHITE, polygon
from nearfar.pictures.page import MARGIN, TITLE, Caption, Entry, Panel, composed

if TYPE_CHECKING:
    from nearfar.localization import Localization

_SIZE = 1000
"""Longer side of an overlay in pixels."""

_HOW_TO_READ = {
    "blend": "Half of each: sharp where they are aligned, double where they are not",
    "checkerboard": "Squares of one and of the other: edges run on where they are aligned",
}


def overlay_pages(localization: "Localization") -> dict[str, RGBPixels]:
    """Pages by name: blend and checkerboard in the frame of either image, as far as they exist."""
    pages = {}
    above, below = near_on_far(localization, _SIZE, _SIZE), far_on_near(localization, _SIZE, _SIZE)
    for kind in ("blend", "checkerboard"):
        if above is not None:
            panel = _panel(above, kind, "Near image over the far image")
            if localization.footprint is not None:
                polygon(panel.pixels, panel.on_panel(localization.footprint), MARK, 1, WHITE)
            pages[kind] = _page(localization, panel, kind)
        if below is not None:
            panel = _panel(below, kind, "Far image over the near image")
            pages[f"far_in_near_{kind}"] = _page(localization, panel, kind)
    return pages


def _panel(overlay: Overlay, kind: str, title: str) -> Panel:
    pixels = overlay.blend() if kind == "blend" else overlay.checkerboard()
    return Panel(pixels, MARGIN, MARGIN + TITLE, overlay.frame_from_far, title, overlay.note)


def _page(localization: "Localization", panel: Panel, kind: str) -> RGBPixels:
    points = localization.points
    entries = (Entry(f"{points.inliers.sum():,} of {len(points):,} point matches agree"),)
    return composed((panel,), Caption(_HOW_TO_READ[kind], entries))
