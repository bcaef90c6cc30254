"""Frames of videos, one after the other, with their times.

OpenCV decodes them with the FFmpeg that its package holds, so that no extra is needed.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.errors import ImageError, SettingsError
from nearfar.imaging.decoding import check_limit, regular_file
from nearfar.imaging.image import read_image

_QUIET = "-8"
"""Level at which FFmpeg logs nothing; errors are ours to tell."""
ROUNDING = 1e-4
"""Seconds by which the times of frames are rounded in files."""
HALF_MILLISECOND = 5e-4
"""Seconds by which the times of frames are rounded in their names."""
SEEK_BACK = 1.0
"""Milliseconds before a time at which to begin to look for its frame."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture of a video or of a sequence of images.

    Attributes:
        index: number of the frame in the video, from 0.
        seconds: time of the frame since the start of the video.
        pixels: (height, width, 3) RGB, as displayed.
    """

    index: int
    seconds: float
    pixels: RGBPixels

    @property
    def name(self) -> str:
        """Return a name that sorts by time, such as 000012.340 for 12.34 seconds."""
        return f"{self.seconds:010.3f}"


def read_frames(
    file: str | os.PathLike[str], *, fps: float | None = None, max_pixels: int = 200_000_000
) -> Iterator[Frame]:
    """Yield the frames of a video; only one is in memory.

    Args:
        file: the video, in any format that FFmpeg decodes.
        fps: frames to take a second of the video, those that come first after each step of time;
            None: all.
        max_pixels: refuse videos with more pixels a frame.

    Raises:
        ImageError: the file is missing or cannot be decoded, or its frames are too large.
        SettingsError: `fps` is not above 0.
    """
    check_rate(fps)
    path = regular_file(file)
    with _opened(path, max_pixels) as video:
        yield from _decoded(path, video, fps)


def frame_at(
    file: str | os.PathLike[str], seconds: float, *, max_pixels: int = 200_000_000
) -> RGBPixels:
    """Return the frame of a video at a time, as displayed.

    Args:
        file: the video.
        seconds: time of the frame; the last frame that is not later is taken.
        max_pixels: refuse videos with more pixels a frame.

    Raises:
        ImageError: the video cannot be decoded, its frames are too large, or it has none so early.
    """
    path = regular_file(file)
    with _opened(path, max_pixels) as video:
        found = _found(video, 1000 * seconds - SEEK_BACK, seconds)
        if found is None:  # Behind the end, FFmpeg may find no place to begin.
            found = _found(video, 0.0, seconds)
    if found is None:
        raise ImageError(f"{path} has no frame at {seconds:.3f} s")
    return found


def _found(video: cv2.VideoCapture, begin: float, seconds: float) -> RGBPixels | None:
    """Return the last frame that is not later than a time, sought from another one in ms on.

    The first frame is returned even if it is later; None where there is no frame.
    """
    video.set(cv2.CAP_PROP_POS_MSEC, max(0.0, begin))
    found: RGBPixels | None = None
    while video.grab():
        later = video.get(cv2.CAP_PROP_POS_MSEC) / 1000 > seconds + ROUNDING + HALF_MILLISECOND
        if later and found is not None:
            break
        read, pixels = video.retrieve()
        if not read:
            break
        found = np.ascontiguousarray(pixels[..., ::-1])
        if later:
            break
    return found


@contextmanager
def _opened(path: Path, max_pixels: int) -> Iterator[cv2.VideoCapture]:
    """Open a video whose frames are not too large, and release it at the end."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", _QUIET)
    video = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    try:
        if not video.isOpened():
            raise ImageError(f"{path} is not a video that FFmpeg can decode: convert it to MP4")
        width = int(video.get(cv2.CAP_PROP_FRAME_WIDTH))
        check_limit(str(path), width, int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)), max_pixels)
        yield video
    finally:
        video.release()


class _Clock:
    """Takes the first frame after each step of time."""

    def __init__(self, fps: float | None) -> None:
        self._fps = fps
        self._next = 0.0

    def takes(self, seconds: float) -> bool:
        """Return whether to take the frame of a time."""
        if self._fps is None:
            return True
        if seconds < self._next - ROUNDING:
            return False
        self._next = (np.floor((seconds + ROUNDING) * self._fps) + 1) / self._fps
        return True


def _decoded(path: Path, video: cv2.VideoCapture, fps: float | None) -> Iterator[Frame]:
    index, clock = -1, _Clock(fps)
    while video.grab():
        index += 1
        seconds = max(0.0, video.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        if not clock.takes(seconds):
            continue
        read, pixels = video.retrieve()
        if not read:
            break
        yield Frame(index, seconds, np.ascontiguousarray(pixels[..., ::-1]))
    if index < 0:
        raise ImageError(f"{path} has no frame that can be decoded: convert it to MP4")


def read_sequence(
    files: Iterable[str | os.PathLike[str]],
    *,
    rate: float,
    fps: float | None = None,
    max_pixels: int = 200_000_000,
) -> Iterator[Frame]:
    """Yield the images of a sequence as frames; only one is in memory.

    Args:
        files: image files in their order.
        rate: images that were taken a second.
        fps: frames to take a second; None: all.
        max_pixels: refuse images with more pixels.

    Raises:
        ImageError: an image cannot be read.
        SettingsError: `rate` or `fps` is not above 0.
    """
    check_rate(rate)
    check_rate(fps)
    clock = _Clock(fps)
    for index, file in enumerate(files):
        if clock.takes(index / rate):
            yield Frame(index, index / rate, read_image(file, max_pixels=max_pixels).pixels)


def check_rate(fps: float | None) -> None:
    """Raise a SettingsError where a number of frames a second is not above 0."""
    if fps is not None and not (np.isfinite(fps) and fps > 0):
        raise SettingsError(f"frames a second (--fps) must be a number above 0, not {fps}")
