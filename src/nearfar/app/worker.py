"""The work of a worker process: localize a pair, locate an image in a map, write an export."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter

from nearfar.app.cameras import camera_of_frames, pair_of_cameras
from nearfar.app.exporting import exported, exported_all
from nearfar.app.files import write_whole
from nearfar.app.formats import write_matches
from nearfar.app.parts import large_raster
from nearfar.app.process import (
    Areas,
    AttemptReport,
    Ended,
    Expected,
    ExportAnswer,
    ExportAnswers,
    LocalizePair,
    LocateInMap,
    Message,
    StageReport,
    do_tasks,
)
from nearfar.app.results import Step, Steps, localization_result, map_result
from nearfar.app.track_tasks import ExportTrack, FollowFrames
from nearfar.errors import ImageError, NearfarError
from nearfar.imaging.image import read_image
from nearfar.localization import Localization
from nearfar.localizer import Localizer
from nearfar.maps import DEFAULTS, PACKAGES, open_map
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.tiled import localize_in_raster

MOST_CERTAIN = 0.9995
"""Confidence from which on no figure of it is shown."""
BUDGET = 600.0
"""Seconds after which a pair is not sought any further; a job is given up later."""
CACHE_BYTES = 300_000_000
"""Memory for the features of the images used last."""

WorkerTask = LocalizePair | LocateInMap | ExportAnswer | ExportAnswers | FollowFrames | ExportTrack
TASK: TypeAdapter[WorkerTask] = TypeAdapter(Annotated[WorkerTask, Field(discriminator="kind")])


class Worker:
    """Does tasks; the localizer of the last settings is kept.

    Args:
        send: is called with each report before the last.
    """

    def __init__(self, send: Callable[[Message], None]) -> None:
        self._send = send
        self._localizer: Localizer | None = None

    def do(self, task: WorkerTask) -> Ended:
        """Do a task; the returned report says what went wrong."""
        try:
            if isinstance(task, ExportAnswer):
                return Ended(outcomes=tuple(exported(task)))
            if isinstance(task, ExportAnswers):
                return Ended(outcomes=tuple(exported_all(task)))
            if isinstance(task, FollowFrames | ExportTrack):
                return self._on_track(task)
            return self._localize(task) if isinstance(task, LocalizePair) else self._locate(task)
        except NearfarError as error:
            return Ended(error=str(error))
        except MemoryError:
            return Ended(error="the images are too large for the memory of this machine")
        except Exception as error:
            return Ended(error=f"{type(error).__name__}: {error}")

    def _on_track(self, task: FollowFrames | ExportTrack) -> Ended:
        require("map", *PACKAGES)
        from nearfar.app.following import exported_track, followed

        if isinstance(task, FollowFrames):
            return followed(task, self._send)
        return Ended(outcomes=tuple(exported_track(task)))

    def _localize(self, task: LocalizePair) -> Ended:
        settings = Settings(
            max_effort=task.max_effort,
            matcher=task.matcher,
            device=task.device,
            max_pixels=task.max_pixels,
            budget=BUDGET,
        )
        if self._localizer is None or self._localizer.settings != settings:
            self._localizer = Localizer(settings, cache_bytes=CACHE_BYTES)
        steps = Steps(self._notify_stage, self._notify_step)
        cameras = pair_of_cameras(task.far_camera, task.near_camera)
        near_mask = mask_of(task.near, task.near_mask, task.max_pixels)
        large = large_raster(task.far, task.max_pixels, task.max_tiled_pixels)
        if large is not None:
            if task.far_mask:
                raise ImageError("a far image of this size takes no mask: localize without it")
            if cameras is not None:
                raise ImageError("a far image of this size takes no camera: localize without it")
            found = localize_in_raster(
                self._localizer,
                large,
                task.near,
                model=task.model,
                near_mask=near_mask,
                watcher=steps,
            )
        else:
            found = self._localizer.localize(
                task.far,
                task.near,
                model=task.model,
                intrinsics=cameras,
                far_mask=mask_of(task.far, task.far_mask, task.max_pixels),
                near_mask=near_mask,
                watcher=steps,
            )
        write_matches(task.matches, found.points)
        result = localization_result(found, steps.best, settings)
        _write(task.result, result)
        if not found.localized:
            return Ended(summary="not found", explanation=result["explanation"])
        return Ended(
            summary=in_words(found),
            found=True,
            warning=result["warning"] or "",
            expected_error=_expected(found),
        )

    def _locate(self, task: LocateInMap) -> Ended:
        self._notify_stage("searching the map")
        map_ = open_map(task.folder, settings=DEFAULTS.replace(max_pixels=task.max_pixels))
        from nearfar.app.following import check_served
        from nearfar.maps.files import file_of

        check_served(map_, task.served)
        camera = camera_of_frames(task.camera)
        found = map_.locate(task.query, top=task.top, candidates=task.candidates, intrinsics=camera)
        shown = {each.image for each in found.answers} | {each.image for each in found.candidates}
        files = {image: str(file_of(image, task.folder)) for image in shown}
        _write(task.result, map_result(found, files))
        if not found.located:
            return Ended(summary="not found")
        return Ended(summary=f"in {Path(found.answers[0].image).name}", found=True)

    def _notify_stage(self, stage: str) -> None:
        self._send(StageReport(stage=stage))

    def _notify_step(self, step: Step) -> None:
        agreeing = int(step.inliers.sum())
        self._send(AttemptReport(step=step.name, matches=len(step.far), agreeing=agreeing))


def _expected(found: Localization) -> Expected | None:
    if found.expected_error is None:
        return None
    known = found.expected_error.to_dict()
    return Expected(**{name: known[name] for name in Expected.model_fields})


def in_words(found: Localization) -> str:
    """Return scale change and confidence of an answer; near certainty is no certainty."""
    parts, change, confidence = [], found.scale_change, found.confidence
    if change is not None:
        parts.append(f"{change:.1f}x larger" if change >= 1 else f"{1 / change:.1f}x smaller")
    if confidence is not None:
        digits = 1 if confidence > 0.99 else 0
        known = "> 99.9%" if confidence > MOST_CERTAIN else f"{confidence:.{digits}%}"
        parts.append(f"confidence {known}")
    return ", ".join(parts)


def mask_of(file: Path, areas: Areas, max_pixels: int) -> NDArray[np.uint8] | None:
    """Return the mask of an image without some areas; None where there are none.

    Args:
        file: the image.
        areas: polygons that are left out, in pixels of the image as displayed.
        max_pixels: see `Settings`.

    Returns:
        (height, width) of the image, 0 in the areas.

    Raises:
        ImageError: the image cannot be read.
    """
    if not areas:
        return None
    image = read_image(file, max_pixels=max_pixels)
    mask = np.full((image.height, image.width), 255, np.uint8)
    for area in areas:
        # Each alone: where two areas overlap, both are left out.
        cv2.fillPoly(mask, [np.rint(np.array(area)).astype(np.int32)], 0)
    return mask


def _write(file: Path, content: dict[str, Any]) -> None:
    write_whole(file, json.dumps(content, allow_nan=False).encode())


if __name__ == "__main__":
    do_tasks(lambda send: Worker(send).do, TASK)
