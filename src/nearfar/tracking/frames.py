"""The frames of a journey: files in their order, videos, and a folder that is still written to."""

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nearfar.arrays import RGBPixels
from nearfar.errors import MapError, SettingsError
from nearfar.imaging.decoding import image_suffixes
from nearfar.imaging.kinds import is_video_name
from nearfar.imaging.video import check_rate, read_frames
from nearfar.maps.images import NamedImages
from nearfar.storage.locations import natural_key

POLLED_EVERY = 0.2
"""Seconds between two looks into a folder that is followed."""


@dataclass(frozen=True, eq=False)
class JourneyFrame:
    """A frame to be found.

    Attributes:
        index: number of the frame, from 0.
        time: in seconds since the first.
        name: of its file; of a frame of a video, the video and the time.
        image: its file, or its pixels.
    """

    index: int
    time: float
    name: str
    image: Path | RGBPixels


def frames_of(
    sources: Sequence[Path], fps: float | None, max_pixels: int
) -> Iterator[JourneyFrame]:
    """Yield the frames of files and folders of images, or of one video.

    Args:
        sources: images and folders of images, which are sorted by name; or one video.
        fps: images that were taken a second, 1 by default; of a video, frames to take a second, by
            default all.
        max_pixels: refuse videos with more pixels a frame.

    Raises:
        ImageError: the video cannot be decoded.
        MapError: there is no such file, or no image in a folder.
        SettingsError: `fps` is not above 0, or a video is one of several sources.
    """
    check_rate(fps)
    videos = [each for each in sources if is_video_name(each) and not each.is_dir()]
    if not videos:
        yield from _of_files(sources, fps or 1.0)
        return
    if len(sources) > 1:
        raise SettingsError("follow one video at a time, or images")
    for index, frame in enumerate(read_frames(videos[0], fps=fps, max_pixels=max_pixels)):
        name = f"{videos[0].name}#t={frame.name}"
        yield JourneyFrame(index, frame.seconds, name, frame.pixels)


def _of_files(sources: Sequence[Path], fps: float) -> Iterator[JourneyFrame]:
    files: list[Path] = []
    for source in sources:
        if source.is_dir():
            inside = [each for each in NamedImages(source).files() if isinstance(each, Path)]
            files += sorted(inside, key=lambda each: natural_key(str(each)))
        else:
            files.append(source)
    if not files:
        raise MapError("there are no frames: give files, folders or a video")
    for index, file in enumerate(files):
        yield JourneyFrame(index, index / fps, file.name, file)


def followed(folder: Path, fps: float | None, idle: float | None) -> Iterator[JourneyFrame]:
    """Yield the images of a folder as they are written, by their names.

    An image is taken when its size has not changed between two looks. One whose name comes before
    that of an image that was taken is left out.

    Args:
        folder: the folder.
        fps: images that are taken a second, 1 by default.
        idle: seconds without a new image after which to end; None: never.

    Raises:
        MapError: there is no such folder.
        SettingsError: `fps` is not above 0.
    """
    check_rate(fps)
    if not folder.is_dir():
        raise MapError(f"there is no folder {folder} to follow")
    sizes: dict[Path, int] = {}
    last: Path | None = None
    index, waited = 0, clock.monotonic()
    while idle is None or clock.monotonic() - waited < idle:
        seen = {each: each.stat().st_size for each in _images_in(folder) if each.is_file()}
        for file in sorted(seen, key=lambda each: natural_key(each.name)):
            late = last is not None and natural_key(file.name) <= natural_key(last.name)
            if late or not seen[file]:
                continue
            if sizes.get(file) != seen[file]:
                break
            yield JourneyFrame(index, index / (fps or 1.0), file.name, file)
            last, index, waited = file, index + 1, clock.monotonic()
        sizes = seen
        clock.sleep(POLLED_EVERY)


def _images_in(folder: Path) -> Iterator[Path]:
    suffixes = image_suffixes()
    for each in folder.iterdir():
        if each.suffix.lower() in suffixes and not each.name.startswith("."):
            yield each
