"""Changes between two views that light, season, weather, water and other sensors make.

Each is a rough model of what it is named after; what matters is that a place keeps its structure.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
"""(height, width, 3) with values about 0 to 255."""
Numbers = NDArray[np.floating]
"""The same, of any precision."""


def under_other_conditions(image: Image, rng: np.random.Generator) -> Image:
    """Change an image by one of the conditions of this file.

    Args:
        image: RGB.
        rng: of all that is drawn.
    """
    condition = CONDITIONS[int(rng.integers(len(CONDITIONS)))]
    return np.clip(condition(image, rng), 0, 255).astype(np.float32)


def other_tones(image: Image, rng: np.random.Generator) -> Numbers:
    """Map values along a curve that rises mostly, one for each channel, as foliage of a season."""
    steps = rng.normal(0.6, 1.0, (3, 6))
    curves = np.cumsum(np.concatenate([np.zeros((3, 1)), steps], axis=1), axis=1)
    curves -= curves.min(axis=1, keepdims=True)
    curves *= 255 / np.maximum(curves.max(axis=1, keepdims=True), 1e-6)
    at = np.linspace(0, 255, curves.shape[1])
    values = np.clip(image, 0, 255)
    return np.stack([np.interp(values[..., c], at, curves[c]) for c in range(3)], axis=-1)


def other_band(image: Image, rng: np.random.Generator) -> Numbers:
    """Mix the channels with weights of both signs into one, as near infrared does."""
    weights = rng.normal(0, 1, 3)
    band = image @ (weights / np.abs(weights).sum())
    return np.repeat(_stretched(band)[..., np.newaxis], 3, axis=2)


def thermal(image: Image, rng: np.random.Generator) -> Numbers:
    """Return grey values along any curve, softly, as temperatures that go with brightness."""
    grey = np.clip(image.mean(axis=2), 0, 255)
    curve = rng.uniform(0, 255, 5)
    warm = np.interp(grey, np.linspace(0, 255, 5), curve).astype(np.float32)
    warm = cv2.GaussianBlur(warm, (0, 0), sigmaX=rng.uniform(0.5, 1.5))
    return np.repeat(_stretched(warm)[..., np.newaxis], 3, axis=2)


def shadowed(image: Image, rng: np.random.Generator) -> Numbers:
    """Darken all on one side of a few lines, bluish, as sharp shadows of buildings or trees do."""
    x, y = _grid(image)
    shade = np.ones(image.shape[:2], np.float32)
    for _ in range(int(rng.integers(1, 4))):
        angle = rng.uniform(0, 2 * np.pi)
        beyond = (x - rng.uniform(0, 1)) * np.cos(angle) + (y - rng.uniform(0, 1)) * np.sin(angle)
        shade[(beyond > 0) & (beyond < rng.uniform(0.1, 0.6))] = rng.uniform(0.25, 0.7)
    tint = (1 - shade[..., np.newaxis]) * np.array([-0.1, 0.0, 0.15], np.float32)
    return image * (shade[..., np.newaxis] + tint)


def hazy(image: Image, rng: np.random.Generator) -> Numbers:
    """Blend with the light of the air, more on one side of the image."""
    seen = _ramp(image, rng, *rng.uniform(0.25, 1.0, 2))[..., np.newaxis]
    air = rng.uniform(150, 250) + rng.normal(0, 8, 3)
    return np.asarray(image * seen + air * (1 - seen))


def under_water(image: Image, rng: np.random.Generator) -> Numbers:
    """Take colours away by their wavelength, add a veil, and particles that shine."""
    path = rng.uniform(0.3, 3.0)
    lost = np.array([0.6, 0.15, 0.1]) * np.exp(rng.normal(0, 0.3, 3))
    seen = np.exp(-lost * path)
    veil = np.array([rng.uniform(0, 60), rng.uniform(60, 160), rng.uniform(60, 160)])
    veiled = image * seen + veil * (1 - np.exp(-0.25 * path))
    height, width = image.shape[:2]
    dots = np.zeros((height, width), np.float32)
    count = int(rng.poisson(width * height / 700))
    dots[rng.integers(0, height, count), rng.integers(0, width, count)] = 255
    shining = cv2.GaussianBlur(dots, (0, 0), sigmaX=rng.uniform(0.6, 1.6))
    return np.asarray(veiled + shining[..., np.newaxis])


def snowy(image: Image, rng: np.random.Generator) -> Numbers:
    """Cover what is dark or at random with white, in patches with soft borders."""
    height, width = image.shape[:2]
    coarse = rng.normal(0, 1, (int(rng.integers(3, 9)),) * 2).astype(np.float32)
    patches = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    patches = patches + rng.normal(0, 1) * (image.mean(axis=2) / 127 - 1)
    covered = np.clip(3 * (patches - rng.uniform(0, 1)), 0, 1)[..., np.newaxis]
    return np.asarray(image * (1 - covered) + rng.uniform(200, 250) * covered)


CONDITIONS = (other_tones, other_band, thermal, shadowed, hazy, under_water, snowy)


def _stretched(band: Image) -> Image:
    """Return values from 0 to 255, by the darkest and the brightest of most pixels."""
    low, high = np.percentile(band, (1, 99))
    return np.asarray((band - low) * (255 / max(high - low, 1.0)), np.float32)


def _grid(image: Image) -> tuple[Image, Image]:
    """Return x and y of each pixel from 0 to 1."""
    height, width = image.shape[:2]
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    return x.astype(np.float32), y.astype(np.float32)


def _ramp(image: Image, rng: np.random.Generator, start: float, end: float) -> Image:
    """Return values that change linearly from one side to the other, in a random direction."""
    x, y = _grid(image)
    angle = rng.uniform(0, 2 * np.pi)
    along = (x - 0.5) * np.cos(angle) + (y - 0.5) * np.sin(angle) + 0.5
    return np.asarray(start + (end - start) * np.clip(along, 0, 1), np.float32)
