"""Options and limits with which the app is started."""

import ipaddress
import os
from dataclasses import dataclass
from pathlib import Path

MEGABYTE = 1_000_000


@dataclass(frozen=True)
class Limits:
    """Bounds of memory, disk space and time, which hold for all requests together.

    Attributes:
        upload_bytes: largest size of one image that is sent.
        body_bytes: largest size of any other request.
        stored_bytes: largest size of all images that were sent and are kept.
        pixels: largest number of pixels of an image that is decoded as a whole.
        tiled_pixels: largest number of pixels of a TIFF that is read by parts.
        tile_bytes: largest size of all tiles that are kept.
        tiles: number of tiles that wait or are cut at a time.
        requests: number of requests that are served at a time.
        uploads: number of images that are received at a time.
        waiting_jobs: largest number of jobs in the queue.
        kept_jobs: number of jobs that are kept; the oldest that has ended makes room.
        annotations: largest number of annotations.
        large_pictures: number of pictures of large images that wait or are made at a time.
        job_seconds: longest time of a job.
        track_seconds: longest time of a job that follows a camera; it can be gone on with.
        track_frames: largest number of frames of a track.
        track_bytes: largest size of a file of states that is opened.
        picture_seconds: longest time to decode an image and make a picture of it.
        head_seconds: longest time until the head of a request has arrived.
        body_seconds: longest time until the body of a request has arrived, beside that for its
            bytes at `least_rate`.
        least_rate: bytes a second that a body must bring on average.
        connections: number of connections from which on the one that has been idle for longest
            makes room for a new one.
    """

    upload_bytes: int = 200 * MEGABYTE
    body_bytes: int = MEGABYTE
    stored_bytes: int = 4000 * MEGABYTE
    pixels: int = 100_000_000
    tiled_pixels: int = 20_000_000_000
    tile_bytes: int = 1000 * MEGABYTE
    tiles: int = 24
    requests: int = 48
    uploads: int = 3
    waiting_jobs: int = 12
    kept_jobs: int = 200
    annotations: int = 2000
    large_pictures: int = 8
    job_seconds: float = 900.0
    track_seconds: float = 7200.0
    track_frames: int = 20_000
    track_bytes: int = 100 * MEGABYTE
    picture_seconds: float = 60.0
    head_seconds: float = 10.0
    body_seconds: float = 20.0
    least_rate: float = 200_000.0
    connections: int = 256


@dataclass(frozen=True)
class AppConfiguration:
    """Options with which the app is started.

    Attributes:
        folders: folders whose images, maps and results may be opened.
        data: folder in which the app keeps copies of dropped images, jobs and annotations.
        host: address to listen at.
        token: the token that every request must bring; None where none is needed.
        limits: bounds of memory, disk and time.
    """

    folders: tuple[Path, ...]
    data: Path
    host: str = "127.0.0.1"
    token: str | None = None
    limits: Limits = Limits()

    @property
    def local(self) -> bool:
        """Whether only this machine can connect."""
        return is_loopback(self.host)


def is_loopback(host: str) -> bool:
    """Whether a host is this machine and can be reached from it alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def default_data() -> Path:
    """Return $NEARFAR_APP_DATA, or the system's folder for a user's data."""
    import platformdirs

    named = os.environ.get("NEARFAR_APP_DATA")
    return Path(named) if named else platformdirs.user_data_path("nearfar", False) / "app"
