"""Frames of videos as the images of a map, and as queries.

A map names files, so that frames are written as JPEG files that are named by their time.
"""

import os
from dataclasses import dataclass
from pathlib import Path

from PIL import Image as PillowImage

from nearfar.imaging.video import check_rate, read_frames
from nearfar.storage.locations import replaced

QUALITY = 95
"""Quality of the JPEG files; videos are compressed more."""


@dataclass(frozen=True)
class VideoFrames:
    """Frames of a video; those that are written already are left as they are.

    Attributes:
        video: the video file.
        folder: for the frames, made where missing; keep it as long as the map.
        fps: frames to take a second of the video.
        max_pixels: refuse videos with more pixels a frame.
    """

    video: str | os.PathLike[str]
    folder: Path
    fps: float = 1.0
    max_pixels: int = 200_000_000

    def files(self) -> list[Path]:
        """See `ImageSet.files`.

        Raises:
            ImageError: the video cannot be decoded.
            OSError: a frame cannot be written.
            SettingsError: `fps` is not above 0.
        """
        check_rate(self.fps)
        self.folder.mkdir(parents=True, exist_ok=True)
        found = []
        for frame in read_frames(self.video, fps=self.fps, max_pixels=self.max_pixels):
            file = self.folder / f"{frame.name}.jpg"
            if not file.exists():
                with replaced(file) as incomplete:
                    PillowImage.fromarray(frame.pixels).save(incomplete, "JPEG", quality=QUALITY)
            found.append(file)
        return found
