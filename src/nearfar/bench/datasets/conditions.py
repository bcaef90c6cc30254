"""Conditions: how light, season, sensor, haze or water change a photograph, place by place.

A condition changes values alone; each pixel stays where it is, so that true points stay true. The
models are simple ones of how an image is formed, with random parameters.
"""

import functools
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels

Values = NDArray[np.float32]
"""(height, width, channels) with values from 0 to 1."""
Condition = Callable[[Values, np.random.Generator], Values]

_WATER = np.array([0.6, 0.12, 0.06])
"""Attenuation of red, green and blue per metre of water, as in clear coastal water."""


def changed(pixels: RGBPixels, condition: str, rng: np.random.Generator) -> RGBPixels:
    """Return a photograph as it would be under a condition.

    Args:
        pixels: (height, width, 3) the photograph.
        condition: a name of `CONDITIONS` or `WATERS`.
        rng: generator of the parameters.
    """
    seen = (CONDITIONS | WATERS)[condition](np.asarray(pixels / 255, np.float32), rng)
    noisy = seen + rng.normal(0, 0.01, seen.shape)
    return np.rint(255 * np.clip(noisy, 0, 1)).astype(np.uint8)


def relit(values: Values, rng: np.random.Generator) -> Values:
    """Another time of day: a tone curve, a colour of the light, and light that varies by place."""
    toned = values ** np.exp(rng.normal(0, 0.6))
    colour = np.exp(rng.normal(0, 0.2, 3))
    gain = np.exp(0.7 * _smooth(values.shape[:2], rng))[..., np.newaxis]
    shadow = _smooth(values.shape[:2], rng)[..., np.newaxis] > rng.uniform(0.4, 1.0)
    dark = np.where(shadow, rng.uniform(0.25, 0.6), 1)
    return np.asarray(toned * colour * gain * dark, np.float32)


def other_sensor(values: Values, rng: np.random.Generator) -> Values:
    """Another band, as in near infrared: grey, where some colours are bright and others dark."""
    weights = rng.normal(0, 1, 3)
    band = values @ weights.astype(np.float32)
    low, high = np.percentile(band, (1, 99))
    grey = np.clip((band - low) / max(1e-6, float(high - low)), 0, 1)
    return np.asarray(np.repeat(grey[..., np.newaxis], 3, axis=2), np.float32)


def haze(values: Values, rng: np.random.Generator) -> Values:
    """Light that air scatters: contrast falls with a distance that varies by place."""
    distance = 1 + 0.4 * _smooth(values.shape[:2], rng)[..., np.newaxis]
    passed = np.exp(-rng.uniform(0.7, 1.8) * np.maximum(distance, 0.1))
    air = np.array([0.82, 0.85, 0.9]) * rng.uniform(0.85, 1.05)
    return np.asarray(values * passed + air * (1 - passed), np.float32)


def underwater(values: Values, rng: np.random.Generator) -> Values:
    """Water: colours lost with the distance, red first, a veil of scattered light, particles."""
    return _through_water(values, rng, rng.uniform(1.5, 5))


def _through_water(values: Values, rng: np.random.Generator, metres: float) -> Values:
    """Return a photograph through so many metres of water, more or less by place."""
    distance = metres * (1 + 0.3 * _smooth(values.shape[:2], rng))[..., np.newaxis]
    passed = np.exp(-_WATER * np.maximum(distance, 0.1))
    veil = np.array([0.05, 0.35, 0.42]) * rng.uniform(0.6, 1.2)
    scattered = 1 - np.exp(-rng.uniform(0.08, 0.3) * np.maximum(distance, 0.1))
    seen = values * passed * (1 - scattered) + veil * scattered
    return _with_particles(np.asarray(seen, np.float32), rng)


def _with_particles(values: Values, rng: np.random.Generator) -> Values:
    """Add bright discs out of focus, of 1 to 6 pixels, about one in 4,000 pixels."""
    height, width = values.shape[:2]
    lit = np.zeros((height, width), np.float32)
    for _ in range(height * width // 4000):
        x, y = int(rng.integers(width)), int(rng.integers(height))
        radius = int(rng.integers(1, 7))
        cv2.circle(lit, (x, y), radius, float(rng.uniform(0.1, 0.5)), -1)
    glow = cv2.GaussianBlur(lit, (0, 0), 1.2)[..., np.newaxis]
    return np.asarray(values + glow * (1 - values), np.float32)


def _smooth(size: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return (height, width) values that vary slowly over an image, about normally distributed."""
    coarse = rng.normal(0, 1, (5, 5)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_CUBIC))


CONDITIONS: dict[str, Condition] = {
    "relit": relit,
    "sensor": other_sensor,
    "haze": haze,
    "underwater": underwater,
}

WATERS: dict[str, Condition] = {
    f"{metres} m of water": functools.partial(_through_water, metres=metres)
    for metres in (1, 2, 4, 8)
}
"""Conditions of mode benthic: the sea bed through some metres of water."""
