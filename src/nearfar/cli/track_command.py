"""The command `nearfar map track`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from nearfar.cli.map_command import AsJson, MapFolder
from nearfar.cli.options import CameraOption, Flag, WeightOptions, with_weights
from nearfar.maps import DEFAULTS, open_map


def track_command(
    folder: MapFolder,
    frames: list[Path] = [],  # noqa: B006
    /,
    *,
    follow: Annotated[Path | None, Parameter(name="--follow")] = None,
    idle: float | None = None,
    intrinsics: CameraOption = None,
    fps: float | None = None,
    budget: float | None = None,
    as_json: AsJson = False,
    save: Path | None = None,
    export: Annotated[
        tuple[str, ...], Parameter(negative="", metavar="FORMAT", show_default=False)
    ] = (),
    smooth: Flag = False,
    max_pixels: int = DEFAULTS.max_pixels,
    bands: str = "",
    weights: WeightOptions = (),
) -> int:
    """Follow a camera through a map, frame by frame.

    With --save a journey that was stopped goes on where it was. A frame that cannot be read has a
    predicted place.

    Exit status: 0 all frames matched, 3 some did not, 2 bad input or usage.

    Args:
        folder: Folder of the map.
        frames: Images and folders of images in their order, or one video.
        follow: Folder whose images are taken as they are written, in place of FRAMES.
        idle: Seconds without a new image after which --follow ends; by default it never does.
        intrinsics: Camera that takes the frames, as for nearfar map locate. Its distortion is
            undone, and in a georeferenced map it gives the height over the ground.
        fps: Images that were taken a second, 1 by default. Of a video, frames to take a second, by
            default all.
        budget: Seconds that a frame may take: 3 with --follow, else inf by default. A longer search
            of the whole map goes on beside the next frames. With inf each search is waited for, so
            that the results do not depend on the speed of the machine.
        as_json: Print one JSON object a line for each frame instead of text.
        save: Folder for track.jsonl, with a JSON object for each frame, and for the exports.
        export: Write the journey into the folder of --save as csv, geojson, geopackage, gpx, kitti,
            png, sheet or tum; may be repeated.
        smooth: Smooth the whole path at the end. The exports and track-smooth.jsonl have it.
        max_pixels: Refuse images with more pixels, which may be decompression bombs.
        bands: Bands of the frames to show as red, green and blue, such as 4,3,2. One is shown as
            grey.
        weights: File of another model of the descriptor, as nearfar=FILE.
    """
    settings = DEFAULTS.replace(max_pixels=max_pixels, bands=bands)
    map_ = open_map(folder, settings=with_weights(settings, weights))
    from nearfar.cli.journey import Journey

    return Journey(
        tuple(frames), follow, idle, intrinsics, fps, budget, as_json, save, export, smooth
    ).run(map_)
