"""Text on a page, in Pillow's own typeface (which has few letters beyond ASCII)."""

from PIL import ImageDraw, ImageFont

from nearfar.pictures.draw import Colour

INK: Colour = (24, 32, 44)
MUTED: Colour = (104, 114, 130)

_SPACE = 0.3
"""Width of a space as a share of the type's size: the typeface's own is too narrow."""


def write(
    pen: ImageDraw.ImageDraw, x: float, baseline: float, text: str, size: int, colour: Colour
) -> float:
    """Write one line of text of a size in pixels; return the column at which it ends."""
    font = ImageFont.load_default(size)
    for word in text.split(" "):
        pen.text((x, baseline), word, colour, font, anchor="ls")
        x += font.getlength(word) + _SPACE * size
    return x - _SPACE * size


def shortened(text: str, size: int, room: float) -> str:
    """The text, or as much of it as fits into so many pixels."""
    if text_width(text, size) <= room:
        return text
    while text and text_width(text + " ...", size) > room:
        text = text[:-1]
    return text.rstrip() + " ..."


def text_width(text: str, size: int) -> float:
    """Width of one line of text in pixels."""
    font = ImageFont.load_default(size)
    return sum(font.getlength(word) for word in text.split(" ")) + _SPACE * size * text.count(" ")
