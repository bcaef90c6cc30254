"""COLMAP models of a made room, as text."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from nearfar.arrays import RGBPixels
from nearfar.features.detection import detect, sift
from nearfar.geometry.intrinsics import CameraIntrinsics
from tests.maps.world.room import CAMERA, SIZE, Pose, Room

KEPT = 0.4
"""Share of the keypoints of an image that the model has points of."""


def write_model(
    folder: Path,
    room: Room,
    views: Mapping[str, tuple[Pose, RGBPixels]],
    camera: CameraIntrinsics = CAMERA,
) -> Path:
    """A model of images by name; its points are exact, at keypoints of the images."""
    rng = np.random.default_rng(0)
    # In COLMAP the centre of the top left pixel is (0.5, 0.5).
    middle = f"{camera.cx + 0.5} {camera.cy + 0.5}"
    images: list[str] = []
    points: list[str] = []
    for number, (name, (pose, pixels)) in enumerate(views.items(), 1):
        keypoints = detect(pixels, sift(0.04, 3000)).xy
        scene = room.points(pose, keypoints, camera)
        x, y, z, w = pose.quaternion * [-1, -1, -1, 1]
        tx, ty, tz = -pose.rotation.T @ pose.centre
        images.append(f"{number} {w} {x} {y} {z} {tx} {ty} {tz} 1 {name}")
        seen = []
        for index, (pixel, point) in enumerate(zip(keypoints + 0.5, scene, strict=True)):
            known = np.isfinite(point).all() and rng.random() < KEPT
            seen.append(f"{pixel[0]} {pixel[1]} {len(points) + 1 if known else -1}")
            if known:
                x3, y3, z3 = point
                points.append(f"{len(points) + 1} {x3} {y3} {z3} 0 0 0 0 {number} {index}")
        images.append(" ".join(seen))
    folder.mkdir(parents=True)
    size = f"{SIZE[0]} {SIZE[1]}"
    lines = f"1 PINHOLE {size} {camera.fx} {camera.fy} {middle}"
    (folder / "cameras.txt").write_text(lines + "\n")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    (folder / "points3D.txt").write_text("\n".join(points) + "\n")
    return folder
