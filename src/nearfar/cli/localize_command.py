"""`nearfar localize`."""

import itertools
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from nearfar.arrays import Coordinates
from nearfar.batch.pairs import Pair, pairs_with, read_pairs
from nearfar.batch.placements import check_inputs_kept
from nearfar.batch.run import BatchWork
from nearfar.cli.localize_batch import localize_batch
from nearfar.cli.options import (
    BAD_INPUT,
    DEFAULT_WORK,
    FAILED,
    CameraOption,
    Flag,
    Place,
    SettingsOptions,
    WeightOptions,
    WorkOptions,
    with_weights,
)
from nearfar.cli.presets import AsOption, say_deviations
from nearfar.cli.standard_input import STANDARD_INPUT, files_of, shown
from nearfar.cli.world_text import corners_text, place_text
from nearfar.errors import ImageError, MissingExtraError, SettingsError
from nearfar.exports import Exported, Subject, export_all, exporter
from nearfar.exports.ground import place_of
from nearfar.geometry.camera_files import IntrinsicsSource, read_cameras
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.localization import Localization
from nearfar.localizer import Localizer
from nearfar.models import MODEL_NAMES, ModelKind
from nearfar.render import save_localization
from nearfar.settings import Settings
from nearfar.tiled import localize_in_tiles
from nearfar.undistortion import outline_in_far
from nearfar.verification.degeneracy import is_credible_place
from nearfar.verification.expected_error import ExpectedError


@Parameter(name="*", group="Many pairs")
@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """Options for many pairs."""

    pairs: Path | None = None
    """List of pairs, FAR and NEAR on each line, separated by commas, tabs or spaces. Paths are
    relative to the list. A first line may name the columns far and near."""

    near_first: Flag = False
    """The list names the near image first, as the lists of hloc do."""

    out: Place | None = None
    """File for the answers, one JSON object a line; its name ends in .jsonl. Pairs that have a line
    in it are not localized again, so that a batch that was stopped goes on."""

    def asked(self, near: Sequence[Path]) -> bool:
        """Return whether many pairs are asked for, or lines in a file."""
        many = len(near) > 1 or any(each.is_dir() for each in near)
        return many or self.pairs is not None or self.out is not None

    def read(self, far: Path | None, near: Sequence[Path]) -> list[Pair]:
        """Return the pairs.

        Raises:
            MapError: a folder holds no images.
            SettingsError: the list cannot be read, or there are images beside it.
        """
        if self.pairs is not None:
            if far is not None:
                raise SettingsError("--pairs names both images: leave out FAR and NEAR")
            return read_pairs(self.pairs, near_first=self.near_first)
        if far is None or not near:
            raise SettingsError(GIVE_IMAGES)
        if STANDARD_INPUT in (far, *near):
            raise SettingsError("the standard input is for one pair: name the files of many pairs")
        return pairs_with(far, near)


ONE_PAIR = BatchOptions()
GIVE_IMAGES = "give the images FAR and NEAR, or a list of pairs (--pairs LIST)"


def localize_command(
    far: Path | None = None,
    /,
    *near: Path,
    model: ModelKind | None = None,
    intrinsics: CameraOption = None,
    far_camera: CameraOption = None,
    near_camera: CameraOption = None,
    far_mask: Path | None = None,
    near_mask: Path | None = None,
    far_tiles: Flag = False,
    as_json: Annotated[Flag, Parameter(name="--json")] = False,
    save: Path | None = None,
    top: int = 1,
    export: Annotated[
        tuple[str, ...], Parameter(negative="", metavar="FORMAT", show_default=False)
    ] = (),
    dem: Path | None = None,
    preset: AsOption = None,
    weights: WeightOptions = (),
    batch: BatchOptions = ONE_PAIR,
    work: WorkOptions = DEFAULT_WORK,
    settings: SettingsOptions = Settings(),  # noqa: B008
) -> int:
    """Find where the image NEAR lies in the image FAR; or many of them.

    With several NEAR, a folder, --pairs or --out, it prints a JSON object a line. An image that
    cannot be read has a line with the reason, and the others go on. - is the standard input.

    Exit status: 0 localized, 3 no localization found, 2 bad input or usage, or localized but not
    exported in every format. For many pairs: 0 all localized, 3 some not found, 2 some not read.

    Args:
        far: Image that shows more of the scene, smaller.
        near: Image that shows the scene larger; several, or a folder of images.
        model: What to estimate; by default a pose where both cameras are known, else a homography.
        intrinsics: The camera that took both images. It is a file of COLMAP, OpenCV, ROS, Kalibr or
            KITTI, or a model of COLMAP such as OPENCV:fx,fy,cx,cy,k1,k2,p1,p2. FILE#NAME chooses
            one of several cameras. A JSON file may hold two cameras: {"far": [fx, fy, cx, cy],
            "near": [fx, fy, cx, cy]}. exif reads the focal lengths from the photographs, and
            estimate estimates one that both share.
        far_camera: The camera that took FAR, as in --intrinsics. Distortion is undone.
        near_camera: The camera that took NEAR, as in --intrinsics. Distortion is undone.
        far_mask: Image as large as FAR, black where it must not be used.
        near_mask: Image as large as NEAR, black where it must not be used.
        far_tiles: If nothing is found, search windows of FAR as well. This is for panoramas, which
            the working size reduces too much. Only homographies are found.
        as_json: Print one JSON object instead of text.
        save: Folder for localization.json and pictures. For many pairs, folder for contact sheets,
            overview.png with all outlines, the table placements.csv, and the exports. Those of odm
            and geopackage are one for all pairs, others one for each pair that is localized.
        top: Number of places to list and draw: the answer and its alternatives, or the candidates
            that nothing confirms where it failed. The JSON has all, also candidates whose outlines
            are not credible.
        export: Write a file for another tool into the folder of --save; may be repeated. Matches
            and poses: colmap, csv, hloc, kitti, opencv-yaml, tum. Figures: png, svg. Layers of a
            GIS: geojson, geopackage, geotiff, kml, kmz, world-file. Ground control points:
            gdal-gcps, odm, qgis-points.
        dem: Raster of heights in metres, for the heights of --export odm.
        preset: Take the settings of the paper, or those of the code that its authors released
            (nearfar.presets lists them). Options beside it win. They need the weights of ResNet-50.
        weights: Weights of a network, e.g. resnet50=resnet50.pth; may be repeated.
    """
    if top < 1:
        raise SettingsError(f"--top must be at least 1, not {top}")
    formats = tuple(dict.fromkeys(export))
    exporters = [exporter(name) for name in formats]
    if exporters and save is None:
        raise SettingsError("--export needs a folder to write to: --save DIR")
    chosen = with_weights(settings, weights)
    cameras = _cameras(intrinsics, far_camera, near_camera)
    work.take_threads()
    if batch.asked(near):
        _check_options(batch, far_mask, near_mask, top)
        known = None if cameras is None else read_cameras(cameras)
        how = BatchWork(chosen, model, known, far_mask, far_tiles, formats, save, dem)
        pairs = batch.read(far, near)
        if save is not None:
            check_inputs_kept(pairs, [] if batch.pairs is None else [batch.pairs], save)
        say_deviations([chosen], preset)
        return localize_batch(pairs, how, work, batch.out, save)
    if far is None or not near:
        raise SettingsError(GIVE_IMAGES)
    saved, exported = [], Exported((), {})
    with files_of(far, near[0]) as files:
        found = Localizer(chosen).localize(
            *files, model=model, intrinsics=cameras, far_mask=far_mask, near_mask=near_mask
        )
        if far_tiles and not found.localized:
            found = localize_in_tiles(found, *files, chosen, far_mask, near_mask)
        subject, found = _subject(found, far, near[0], dem), shown(found, far, near[0])
        if save is not None:
            saved = save_localization(found, save, images=files, top=top)
            exported = export_all(subject, exporters, save)
    saved += exported.files
    say_deviations([chosen], preset)
    sys.stdout.write((_json(found) if as_json else _text(found, saved, top)) + "\n")
    for name, reason in exported.failed.items():
        sys.stderr.write(f"nearfar: not exported as {name}: {reason}\n")
    if not found.localized:
        return FAILED
    return BAD_INPUT if exported.failed else 0


def _subject(found: Localization, far: Path, near: Path, dem: Path | None) -> Subject:
    """Return what is exported; images are named where one comes from the standard input."""
    if STANDARD_INPUT not in (far, near):
        return Subject(found, dem=dem)
    return Subject(found, far=far.name, near=near.name, dem=dem)


def _check_options(
    batch: BatchOptions, far_mask: Path | None, near_mask: Path | None, top: int
) -> None:
    """Refuse options of one pair where there are many.

    Raises:
        SettingsError: there is such an option.
    """
    if near_mask is not None or top != 1:
        raise SettingsError("--near-mask and --top are for one pair: leave them out for many")
    if far_mask is not None and batch.pairs is not None:
        raise SettingsError("--far-mask is for one FAR: leave it out with --pairs")


def _cameras(both: str | None, far: str | None, near: str | None) -> IntrinsicsSource | None:
    """Return the cameras that the options name; None where they name none."""
    if far is None and near is None:
        return both
    if both is not None:
        raise SettingsError(
            "--intrinsics is the camera of both images: give it, or --far-camera and --near-camera"
        )
    return {"far": far, "near": near}


def _places(found: Localization, top: int) -> list[str]:
    """Return a line for each alternative, or for each candidate where nothing was found."""
    near, known = found.near, found.intrinsics or Intrinsics(None, None)
    lines = []
    for each in found.alternatives[: top - 1]:
        outline = _corners(outline_in_far(each.far_from_near, known, near.width, near.height))
        lines.append(f"alternative: score {each.score:.2f}, outline {outline}")
    credible = (
        each
        for each in found.candidates
        if is_credible_place(
            each.far_from_near, (found.far.width, found.far.height), (near.width, near.height)
        )
    )
    for other in itertools.islice(credible, top):
        outline = _corners(outline_in_far(other.far_from_near, known, near.width, near.height))
        score = "unknown" if other.score is None else f"{other.score:.2f}"
        lines.append(f"unverified: score {score}, outline {outline}")
    return lines


def _corners(outline: Coordinates | None) -> str:
    if outline is None:
        return "not finite"
    corners = outline[:: len(outline) // 4]
    return "  ".join(f"({x:.1f}, {y:.1f})" for x, y in corners)


def _text(found: Localization, saved: list[Path], top: int) -> str:
    inliers = int(found.points.inliers.sum())
    agreement = f"{inliers} of {len(found.points)} point matches agree on a "
    turned = "; the near image is mirrored" if found.mirrored else ""
    lines = [
        f"localized: {agreement}{MODEL_NAMES[found.model]}{turned}"
        if found.localized
        else f"failed: {found.reason}"
    ]
    if found.confidence is not None:
        decided = f", decided by {found.step}" if found.localized else ""
        lines.append(f"confidence: {found.confidence:.2f}{decided}")
    if found.excluded is not None:
        lines.append(f"left out: {found.excluded.matches} matches on an overlay of both pictures")
    if found.alternatives:
        lines.append(f"alternatives: {len(found.alternatives)} other places fit nearly as well")
    if top > 1:
        lines += _places(found, top)
    if found.scale_change is not None:
        lines.append(f"scale change: {found.scale_change:.2f}x")
    if found.footprint is not None:
        lines.append(f"outline of the near image in the far image: {_corners(found.footprint)}")
    lines += _focal_lengths(found) + _on_earth(found)
    if found.expected_error is not None:
        lines.append(_expected(found.expected_error))
    model = found.to_dict()["far_from_near"]
    if model is not None:
        for name, value in model.items():
            rounded = np.array2string(np.array(value), separator=", ", precision=6)
            lines.append(f"{name}: {' '.join(rounded.split())}")
    total = sum(found.seconds.values())
    stages = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in found.seconds.items())
    lines.append(f"{total:.2f} s ({stages})")
    lines += [f"saved {path}" for path in saved]
    return "\n".join(lines)


def _focal_lengths(found: Localization) -> list[str]:
    """Return a line for each camera that no calibration gave."""
    known = found.intrinsics or Intrinsics(None, None)
    sources = {"exif": "by EXIF", "estimated": "estimated"}
    return [
        f"focal length of the {name} camera: {camera.fx:.1f} pixels, {sources[camera.origin]}"
        for name, camera in (("far", known.far), ("near", known.near))
        if camera is not None and camera.origin in sources
    ]


def _json(found: Localization) -> str:
    """Return the JSON object of a localization, with its place on the Earth as `world`."""
    try:
        place = place_of(found)
    except (ImageError, MissingExtraError) as error:
        sys.stderr.write(f"nearfar: no place on the Earth: {error}\n")
        place = None
    world = None if place is None else place.to_dict()
    return json.dumps({**found.to_dict(), "world": world}, allow_nan=False)


def _on_earth(found: Localization) -> list[str]:
    """Return lines with world coordinates; none where the far image is not georeferenced."""
    try:
        place = place_of(found)
    except (ImageError, MissingExtraError) as error:
        return [f"no place on the Earth: {error}"]
    if place is None:
        return []
    centre, outline = place_text(place), corners_text(place)
    return [f"centre on the Earth: {centre}", f"outline on the Earth: {outline}"]


def _expected(error: ExpectedError) -> str:
    if error.corners is None:
        return f"expected error: rotation {error.rotation:.2g}°, direction {error.direction:.2g}°"
    worst = max(error.corners)
    return f"expected error: {error.mean:.2g} pixels in the mean, {worst:.2g} at the worst corner"
