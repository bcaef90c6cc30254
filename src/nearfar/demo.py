"""The scene of the demo: a wall of photographs, and one of them as the near image.

The photographs are real and ship inside scikit-image; the far image is composed from them (hung on
a painted wall, seen from an angle, with a sensor's noise), so that the truth is known exactly.
Only photographs that are free of rights are used:

- astronaut: Eileen Collins, NASA, public domain
- hubble_deep_field: NASA and ESA, public domain
- rocket: SpaceX, released into the public domain
- brick and gravel: CC0 Textures; camera: Lav Varshney; chelsea: Stefan van der Walt; coffee:
  Rachel Michetti; grass: linolafett; retina: Mikael Haggstrom; all CC0
"""

import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.geometry.errors import transfer_errors
from nearfar.geometry.homography import scale_change, scaling, transform, translation
from nearfar.imaging.image import read_image
from nearfar.localization import Localization
from nearfar.runtime import require

METHODS = ("adaptive", "sift", "paper", "objects")
TOLERANCE = 3.0
"""Largest mean error of a correct answer in far pixels."""

_FAR_SIZE = (1200, 900)
_FINE = 2
"""Resolution at which the scene is painted, relative to the far image."""

_WALL_SIZE = (1600, 1200)
_WALL_COLOUR = (214, 196, 172)
_FRAME_WIDTH = 7
_FRAME_COLOURS = ((46, 38, 34), (120, 84, 54), (236, 232, 224))
_MAT_COLOUR = (248, 246, 241)
_FOCAL_LENGTH = 1500.0
_DISTANCE = 1545.0
_AIM = (-22, -30)
"""Point that the camera aims at, in pixels from the wall's centre."""
_TURN = (3.0, -13.0, 1.2)
"""Rotation of the wall against the camera, as a vector in degrees."""

_GAIN, _NOISE = 0.92, 2.0
_SEED = 2018


@dataclass(frozen=True)
class Print:
    """A framed photograph on the wall.

    Attributes:
        file: name of the photograph in scikit-image's data.
        x: left side of the frame in pixels right of the wall's centre.
        y: top of the frame in pixels below the wall's centre.
        width: width of the photograph in pixels of the wall.
        mat: width of the white mat around it.
        frame: number of its frame colour.
        part: what of the photograph is printed: left, top, width and height in its pixels; None
            for all.
    """

    file: str
    x: int
    y: int
    width: int
    mat: int
    frame: int
    part: tuple[int, int, int, int] | None = None

    def photograph(self) -> RGBPixels:
        """Return the printed part of the photograph, (height, width, 3), at full size.

        Raises:
            MissingExtraError: scikit-image is missing.
            ImageError: it lacks this photograph.
        """
        whole = _photograph(self.file)
        if self.part is None:
            return whole
        left, top, width, height = self.part
        return whole[top : top + height, left : left + width]


TARGET = Print("astronaut.png", 12, -112, 92, 8, 0)
PRINTS = (
    Print("hubble_deep_field.jpg", -562, -402, 290, 22, 0),
    Print("coffee.png", -562, -62, 170, 14, 1, (150, 0, 300, 200)),
    Print("camera.png", -322, -62, 84, 10, 0, (120, 50, 240, 240)),
    Print("chelsea.png", -542, 124, 260, 18, 2),
    Print("rocket.jpg", -184, -402, 300, 20, 2),
    Print("retina.jpg", -176, -120, 120, 13, 1),
    Print("brick.png", -200, 76, 96, 10, 2),
    Print("gravel.png", -200, 226, 96, 10, 0),
    Print("camera.png", 200, -402, 190, 18, 1),
    Print("grass.png", 468, -402, 70, 10, 2),
    Print("hubble_deep_field.jpg", 468, -268, 70, 10, 0, (250, 220, 300, 300)),
    Print("chelsea.png", 166, -134, 200, 15, 0, (100, 40, 240, 180)),
    Print("rocket.jpg", 440, -134, 96, 12, 1, (120, 60, 240, 360)),
    Print("coffee.png", -30, 96, 300, 20, 1),
    Print("gravel.png", 352, 96, 180, 16, 2, (100, 100, 300, 300)),
    TARGET,
)


@dataclass(frozen=True, eq=False)
class Scene:
    """A pair of images with the truth.

    Attributes:
        far: (900, 1200, 3) the wall.
        near: (height, width, 3) one of its photographs.
        far_from_near: maps near pixels to far pixels, exactly.
    """

    far: RGBPixels
    near: RGBPixels
    far_from_near: Matrix3


def make_scene() -> Scene:
    """Compose the wall and take one photograph of it as the near image.

    Raises:
        MissingExtraError: scikit-image is missing.
        ImageError: it lacks one of the photographs.
    """
    wall = _painted_wall()
    for item in PRINTS:
        _hang(wall, item)
    camera = _camera()
    size = (_FINE * _FAR_SIZE[0], _FINE * _FAR_SIZE[1])
    seen = cv2.warpPerspective(wall, camera, size, flags=cv2.INTER_LINEAR)
    seen = cv2.resize(seen, _FAR_SIZE, interpolation=cv2.INTER_AREA)
    near = _photograph(TARGET.file)
    reduction = scaling(1 / _FINE, 1 / _FINE)
    return Scene(_exposed(seen), near, reduction @ camera @ _wall_from_photograph(TARGET, near))


def true_scale_change(scene: Scene) -> float:
    """Return the true scale change over a grid of near points."""
    near = _grid(scene)
    change = scale_change(transform(scene.far_from_near, near), near)
    if change is None:
        raise ValueError("the scene maps the near image to one point")
    return change


def true_error(scene: Scene, localization: Localization) -> float:
    """Return the mean distance of estimate and truth over a grid of near points, in far pixels.

    Infinite where there is no homography, or one that sends some of the points to infinity.
    """
    model = localization.far_from_near
    if not isinstance(model, np.ndarray):
        return math.inf
    near = _grid(scene)
    error = transfer_errors(model, transform(scene.far_from_near, near), near).mean()
    return float(error) if np.isfinite(error) else math.inf


def _grid(scene: Scene) -> NDArray[np.float64]:
    """Return (400, 2) near points, evenly spread from edge to edge."""
    height, width = scene.near.shape[:2]
    x, y = np.meshgrid(np.linspace(0, width - 1, 20), np.linspace(0, height - 1, 20))
    return np.column_stack([x.ravel(), y.ravel()])


def _photograph(file: str) -> RGBPixels:
    require("demo", "skimage")
    return read_image(Path(str(files("skimage") / "data" / file))).pixels


def _painted_wall() -> RGBPixels:
    """Paint a warm wall with an uneven coat, lit from above, `_FINE` times as fine."""
    width, height = (_FINE * side for side in _WALL_SIZE)
    random = np.random.default_rng(_SEED)
    coat = cv2.resize(
        random.normal(0, 1, (height // 12, width // 12)).astype(np.float32),
        (width, height),
        interpolation=cv2.INTER_CUBIC,
    )
    x, y = np.linspace(-1, 1, width), np.linspace(0, 1, height)[:, np.newaxis]
    light = 1.06 - 0.16 * x**2 - 0.22 * y**2 + 0.006 * coat
    colour = np.array(_WALL_COLOUR, np.float32)
    return np.asarray(np.clip(light[..., np.newaxis] * colour, 0, 255), np.uint8)


def _hang(wall: RGBPixels, item: Print) -> None:
    """Paint a framed photograph and its shadow onto the fine wall."""
    photograph = item.photograph()
    left, top, width, height = _place(item, photograph)
    mat = _FINE * item.mat
    edge = mat + _FINE * _FRAME_WIDTH
    _cast_shadow(wall, left - edge, top - edge, width + 2 * edge, height + 2 * edge)
    for colour, margin in ((_FRAME_COLOURS[item.frame], edge), (_MAT_COLOUR, mat)):
        wall[top - margin : top + height + margin, left - margin : left + width + margin] = colour
    wall[top : top + height, left : left + width] = cv2.resize(
        photograph, (width, height), interpolation=cv2.INTER_AREA
    )


def _cast_shadow(wall: RGBPixels, left: int, top: int, width: int, height: int) -> None:
    """Darken the wall around a rectangle, more below it than above."""
    soft = 12 * _FINE
    below = 5 * _FINE
    reach = 3 * soft
    shadow = np.zeros((height + 2 * reach, width + 2 * reach), np.float32)
    shadow[reach : reach + height, reach : reach + width] = 0.5
    shadow = cv2.GaussianBlur(shadow, (0, 0), soft / 2)
    top, left = top + below - reach, left - reach
    part = wall[top : top + shadow.shape[0], left : left + shadow.shape[1]]
    part[:] = part * (1 - shadow[..., np.newaxis])


def _place(item: Print, photograph: RGBPixels) -> tuple[int, int, int, int]:
    """Return left, top, width and height of a printed photograph in pixels of the fine wall."""
    height, width = photograph.shape[:2]
    left = _WALL_SIZE[0] // 2 + item.x + item.mat + _FRAME_WIDTH
    top = _WALL_SIZE[1] // 2 + item.y + item.mat + _FRAME_WIDTH
    printed_height = round(_FINE * item.width * height / width)
    return _FINE * left, _FINE * top, _FINE * item.width, printed_height


def _wall_from_photograph(item: Print, photograph: RGBPixels) -> Matrix3:
    """Return the map from pixels of a photograph to pixels of the fine wall."""
    left, top, width, height = _place(item, photograph)
    old_height, old_width = photograph.shape[:2]
    return translation(left, top) @ scaling(width / old_width, height / old_height)


def _camera() -> Matrix3:
    """Return the map from pixels of the fine wall to pixels of the fine far image.

    The camera sees the wall from the side and a little from above.
    """
    rotation, _ = cv2.Rodrigues(np.radians(_TURN))
    plane = np.column_stack([rotation[:, :2], [0, 0, _FINE * _DISTANCE]])
    lens = np.diag([_FINE * _FOCAL_LENGTH, _FINE * _FOCAL_LENGTH, 1])
    aim = [_FINE * (size / 2 + offset) - 0.5 for size, offset in zip(_WALL_SIZE, _AIM, strict=True)]
    centre = [(_FINE * size - 1) / 2 for size in _FAR_SIZE]
    return np.asarray(translation(*centre) @ lens @ plane @ translation(-aim[0], -aim[1]))


def _exposed(seen: RGBPixels) -> RGBPixels:
    """Return the image a little darker, with the noise of a sensor."""
    noise = np.random.default_rng(_SEED).normal(0, _NOISE, seen.shape)
    return np.clip(np.rint(seen * _GAIN + noise), 0, 255).astype(np.uint8)
