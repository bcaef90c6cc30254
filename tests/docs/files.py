"""The files of a reader of the documentation, under the names that its blocks use; small."""

import json
import shutil
from collections.abc import Callable, Mapping
from importlib.resources import as_file, files
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PillowImage
from safetensors.numpy import save_file

import nearfar
from nearfar.arrays import RGBPixels
from nearfar.geometry.homography import transform
from nearfar.networks.squeezenet import FIRES
from tests.conftest import KnownPair
from tests.imaging.test_raster import write_tiff
from tests.maps.world.model_files import write_model
from tests.maps.world.room import CAMERA, Pose, Room

Load = Callable[[str], RGBPixels]

POSES = {
    "far": Pose.of(0, 0, -4),
    "near": Pose.of(0.4, 0.2, -1.5, -3),
    "query": Pose.of(0.3, 0.1, -2.8, -1),
}
"""Of the cameras that look into a room."""
FILM = 31
"""Focal length of these cameras in 35 mm film."""


def write_files(folder: Path, load: Load, pair: KnownPair) -> None:
    """All that the blocks open and no command before them has made.

    Args:
        folder: an empty folder.
        load: a photograph by its name.
        pair: the far and the near image that a block without depth works on.
    """
    room = Room.of(load)
    large = {name: room.seen(pose) for name, pose in POSES.items()}
    views = {name: reduced(pixels, 2) for name, pixels in large.items()}
    for name, pixels in {**views, "overview": pair.far, "closeup": pair.near}.items():
        for suffix in ("jpg", "png"):
            write(folder / f"{name}.{suffix}", pixels, FILM if name in views else 0)
    for name, pixels in {"far": pair.far, "near": pair.near}.items():
        write(folder / "demo" / f"{name}.png", pixels)
    for name in ("far", "near"):
        mask = np.full_like(views[name], 255)
        mask[:20, :40] = 0
        write(folder / f"{name}-mask.png", mask)
        write(folder / f"{name}-with-alpha.png", np.dstack([views[name], mask[..., 0]]))
    write(folder / "masks" / "near.jpg.png", mask)
    whole = np.full(pair.near.shape[:2], 255, np.uint8)
    write(folder / "query-masks" / "closeup.jpg.png", whole)
    _write_cameras(folder)
    _write_photographs(folder, load, pair, views)
    _write_rasters(folder, pair, views)
    _write_posed(folder, room, large)
    _write_pair(folder / "PAIRS" / "homogr" / "astronaut", pair)
    _write_kitti(folder / "KITTI", load("coffee"))
    _write_squeezenet(folder / "FILE")
    with as_file(files("nearfar.networks") / "landmark_network.onnx") as shipped:
        (folder / "RUN").mkdir()
        shutil.copy(shipped, folder / "RUN")
    nearfar.open_map(folder / "MAP", create=True)


def write(
    file: Path, pixels: RGBPixels, film: int = 0, place: tuple[float, float] | None = None
) -> None:
    """Write an image, with a focal length in 35 mm film, or a latitude and longitude."""
    file.parent.mkdir(parents=True, exist_ok=True)
    exif = PillowImage.Exif()
    if film:
        exif[0x010F] = "nearfar"
        exif.get_ifd(0x8769)[0xA405] = film
    if place is not None:
        exif[0x010F] = "nearfar"
        latitude, longitude = ((degrees, 0.0, 0.0) for degrees in place)
        exif.get_ifd(0x8825).update({1: "N", 2: latitude, 3: "E", 4: longitude})
    PillowImage.fromarray(pixels).save(file, quality=95, exif=exif)


def reduced(pixels: RGBPixels, times: int) -> RGBPixels:
    size = pixels.shape[1] // times, pixels.shape[0] // times
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))


def _write_cameras(folder: Path) -> None:
    values = [CAMERA.fx / 2, CAMERA.fy / 2, (CAMERA.cx - 0.5) / 2, (CAMERA.cy - 0.5) / 2]
    (folder / "cameras.json").write_text(json.dumps({"far": values, "near": values}))
    (folder / "camera.json").write_text(json.dumps({"query": values}))
    fx, fy, cx, cy = values
    (folder / "calib.txt").write_text(f"P0: {fx} 0 {cx} 0 0 {fy} {cy} 0 0 0 1 0\n")


def _write_photographs(
    folder: Path, load: Load, pair: KnownPair, views: Mapping[str, RGBPixels]
) -> None:
    for name in ("far", "near"):
        write(folder / "photos" / f"{name}.jpg", views[name])
    write(folder / "photos" / "overview.jpg", pair.far)
    write(folder / "photos" / "old.jpg", load("chelsea"))
    write(folder / "flight" / "1.jpg", pair.far, place=(52.1234, 13.5678))
    write(folder / "more" / "rocket.jpg", load("rocket"))
    for name in ("astronaut", "chelsea", "coffee", "rocket"):
        write(folder / "PHOTOS" / f"{name}.jpg", load(name))
    (folder / "results").mkdir()
    (folder / "pairs.txt").write_text("near.jpg far.jpg\n")
    write(folder / "closeups" / "1.jpg", pair.near)
    (folder / "pairs.csv").write_text("far,near\noverview.jpg,closeups/1.jpg\n")


def _write_rasters(folder: Path, pair: KnownPair, views: Mapping[str, RGBPixels]) -> None:
    for name, pixels in {"map": views["far"], "ortho": pair.far, "overview": pair.far}.items():
        write_tiff(folder / f"{name}.tif", np.moveaxis(pixels, -1, 0))
    write(folder / "drone" / "1.jpg", pair.near)


def _write_posed(folder: Path, room: Room, large: Mapping[str, RGBPixels]) -> None:
    """Images with a COLMAP model, and smaller ones with a list of poses."""
    mapped = {f"{name}.png": (POSES[name], large[name]) for name in ("far", "near")}
    write_model(folder / "sparse" / "0", room, mapped)
    for number, (name, (_, pixels)) in enumerate(mapped.items()):
        write(folder / "images" / name, pixels)
        write(folder / "image_0" / f"{number:06d}.png", reduced(pixels, 2))
    lines = [pose.kitti for pose, _ in mapped.values()]
    (folder / "03.txt").write_text("\n".join(lines) + "\n")


def _write_pair(folder: Path, pair: KnownPair) -> None:
    """A third of the size."""
    near = np.array([[10, 10], [500, 20], [480, 490], [30, 400], [250, 260.0]])
    far = transform(pair.far_from_near, near)
    content = {
        "set": "homogr",
        "far": "far.jpg",
        "near": "near.jpg",
        "far_points": ((far - 1) / 3).tolist(),
        "near_points": ((near - 1) / 3).tolist(),
        "model": "homography",
    }
    write(folder / "far.jpg", reduced(pair.far, 3))
    write(folder / "near.jpg", reduced(pair.near, 3))
    (folder / "pair.json").write_text(json.dumps(content))


def _write_kitti(folder: Path, photograph: RGBPixels) -> None:
    """Two frames of a camera that moves sideways, 10 m before a photograph."""
    sequence, camera = folder / "sequences" / "00", "120 0 70 0 0 120 50 0 0 0 1 0"
    for frame in (0, 5):
        view = reduced(photograph, 4)[:, 2 * frame :][:, :140]
        write(sequence / "image_2" / f"{frame:06d}.png", view)
    (sequence / "calib.txt").write_text(f"P0: {camera}\nP2: {camera}\n")
    poses = np.tile(np.eye(4)[:3], (6, 1, 1))
    poses[:, 0, 3] = np.arange(6) * 2 * 10 / 120
    (folder / "poses").mkdir()
    np.savetxt(folder / "poses" / "00.txt", poses.reshape(6, 12))


def _write_squeezenet(file: Path) -> None:
    """Random weights of SqueezeNet."""
    shapes: dict[str, tuple[int, ...]] = {"features.0": (96, 3, 7, 7)}
    channels = 96
    for fire in FIRES:
        shapes[f"{fire.layer}.squeeze"] = (fire.squeeze, channels, 1, 1)
        shapes[f"{fire.layer}.expand1x1"] = (fire.expand, fire.squeeze, 1, 1)
        shapes[f"{fire.layer}.expand3x3"] = (fire.expand, fire.squeeze, 3, 3)
        channels = 2 * fire.expand
    rng = np.random.default_rng(0)
    tensors = {}
    for name, shape in shapes.items():
        deviation = np.sqrt(2 / np.prod(shape[1:]))
        tensors[f"{name}.weight"] = rng.normal(0, deviation, shape).astype(np.float32)
        tensors[f"{name}.bias"] = np.zeros(shape[0], np.float32)
    save_file(tensors, file)
