"""What a worker process is asked about tracks: to follow a camera, and to export a track."""

from pathlib import Path
from typing import Literal

from nearfar.app.process import Message


class FollowFrames(Message):
    """Follow a camera through an image or a map; a task that was stopped goes on where it was.

    Attributes:
        far: file of the far image, or folder of a map.
        served: the folders in which the images of a map must lie.
        frames: folder of images, or a video.
        fps: see `nearfar.tracking.frames.frames_of`.
        camera: camera of the frames, as `nearfar.app.cameras` reads it; None where not known.
        smooth: whether to smooth the path at the end.
        most_frames: largest number of frames.
        max_pixels: see `Settings`.
        folder: folder for the states and, of a far image, for its map.
    """

    kind: Literal["follow"] = "follow"
    far: Path
    served: tuple[Path, ...]
    frames: Path
    fps: float | None
    camera: str | None
    smooth: bool
    most_frames: int
    max_pixels: int
    folder: Path


class ExportTrack(Message):
    """Write a track in some formats.

    Attributes:
        states: file of the states, `track.jsonl` or `track-smooth.jsonl`.
        map_folder: folder of the map; None where it is not served.
        served: the folders in which the images of the map must lie; empty where any may.
        frames: the folders, files or video of the frames; none where they are not served.
        fps: see `nearfar.tracking.frames.frames_of`.
        formats: names of the formats; empty for all, of which those with pictures are not written.
        folder: folder to write into.
        max_pixels: see `Settings`.
    """

    kind: Literal["export track"] = "export track"
    states: Path
    map_folder: Path | None
    served: tuple[Path, ...]
    frames: tuple[Path, ...]
    fps: float | None
    formats: tuple[str, ...]
    folder: Path
    max_pixels: int
