"""A video of a moving square, made by OpenCV."""

from pathlib import Path

import cv2
import numpy as np

from nearfar.arrays import RGBPixels

COUNT, RATE = 12, 10
"""Number of frames, and frames a second."""


def frame(index: int) -> RGBPixels:
    """A frame: the square moves to the right."""
    pixels = np.full((96, 128, 3), (40, 90, 160), np.uint8)
    pixels[32:64, 8 * index : 8 * index + 32] = (220, 180, 60)
    return pixels


def write_video(file: Path) -> Path:
    """Write the video."""
    out = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (128, 96))
    for index in range(COUNT):
        out.write(frame(index)[..., ::-1])
    out.release()
    return file
