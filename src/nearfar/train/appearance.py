"""Changes of appearance between two views: light, colour, blur, noise, compression, occlusion."""

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.train.conditions import Image, under_other_conditions

OTHER_CONDITIONS = 0.2
"""Share of the views in other conditions."""


def taken(pixels: RGBPixels, side: int, rng: np.random.Generator) -> RGBPixels:
    """Change a view as another camera on another day would, and enlarge it to `side` pixels.

    Args:
        pixels: (height, width, 3) the view with as many pixels as the camera had for it.
        side: of the square that is returned.
        rng: of all that is drawn.
    """
    image = pixels.astype(np.float32)
    if rng.random() < OTHER_CONDITIONS:
        image = under_other_conditions(image, rng)
    image = _in_other_light(_in_other_colours(image, rng), rng)
    image = _blurred(image, rng)
    image += _noise(image.shape, rng)
    seen = np.clip(image, 0, 255).astype(np.uint8)
    if rng.random() < 0.4:
        seen = _compressed(seen, int(rng.integers(20, 95)))
    seen = np.asarray(cv2.resize(seen, (side, side), interpolation=_interpolation(seen, side)))
    return _occluded(seen, rng) if rng.random() < 0.25 else seen


def _interpolation(pixels: RGBPixels, side: int) -> int:
    return int(cv2.INTER_AREA if max(pixels.shape[:2]) > side else cv2.INTER_LINEAR)


def _in_other_colours(image: Image, rng: np.random.Generator) -> Image:
    """Mix and weight the channels a little, or make the view grey; rarely a negative."""
    if rng.random() < 0.25:
        weights = rng.dirichlet((4, 6, 3)).astype(np.float32)
        image = np.repeat((image @ weights)[..., np.newaxis], 3, axis=2)
    else:
        mix = np.eye(3) + rng.normal(0, 0.1, (3, 3))
        mix = mix / mix.sum(axis=0) * np.exp(rng.normal(0, 0.12, 3))
        image = np.asarray(cv2.transform(image, mix.T))
    return 255 - image if rng.random() < 0.03 else image


def _in_other_light(image: Image, rng: np.random.Generator) -> Image:
    """Change exposure, contrast and gamma, and add light and shadow that vary over the image."""
    gamma = np.exp(rng.normal(0, 0.3))
    bright = 255 * cv2.pow(np.clip(image, 0, 255) / 255, gamma)
    contrast, offset = np.exp(rng.normal(0, 0.25)), rng.normal(0, 18)
    bright = (bright - 127) * contrast + 127 + offset
    if rng.random() < 0.5:
        gains = np.exp(rng.normal(0, 0.35, (3, 3))).astype(np.float32)
        size = (image.shape[1], image.shape[0])
        bright = bright * cv2.resize(gains, size, interpolation=cv2.INTER_CUBIC)[..., np.newaxis]
    return np.asarray(bright, np.float32)


def _blurred(image: Image, rng: np.random.Generator) -> Image:
    """Blur by up to 1 pixel, in one direction more than in the other."""
    across, along = rng.uniform(0.01, 1.0, 2) * (rng.random() < 0.7) + 0.01
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigmaX=across, sigmaY=along))


def _noise(shape: tuple[int, ...], rng: np.random.Generator) -> Image:
    """Add sensor noise, by OpenCV's generator, which is ten times as fast as numpy's."""
    cv2.setRNGSeed(int(rng.integers(2**31)))
    return np.asarray(cv2.randn(np.empty(shape, np.float32), 0, rng.uniform(0, 8)))


def _compressed(pixels: RGBPixels, quality: int) -> RGBPixels:
    _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))


def _occluded(pixels: RGBPixels, rng: np.random.Generator) -> RGBPixels:
    """Hide a box of up to a quarter of the area behind one colour."""
    height, width = pixels.shape[:2]
    wide, high = (int(size * rng.uniform(0.15, 0.5)) for size in (width, height))
    x, y = int(rng.integers(0, width - wide)), int(rng.integers(0, height - high))
    hidden = pixels.copy()
    hidden[y : y + high, x : x + wide] = rng.integers(0, 256, 3)
    return hidden
