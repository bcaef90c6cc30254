"""Parallax over error of poses: of a camera that only turned and zoomed, and of pairs of KITTI.

    python benchmarks/parallax.py KITTI [--sample 40]

Cameras count as apart from the limit in `geometry/certainty.py` on, which must lie between both.
"""

import argparse
import math
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from skimage import data

from nearfar import CameraIntrinsics, Intrinsics, Localization, Localizer, RelativePose
from nearfar.arrays import RGBPixels
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.cli.bench.options import sampled
from nearfar.constants import DEFAULT
from nearfar.verification.conditioning import relative_parallax

PHOTOGRAPHS = ("astronaut", "coffee", "chelsea", "rocket")
DEGREES = (0.0, 3.0, 6.0)
ZOOMS = (1.5, 2.0, 3.0)
FOCAL = 900.0


def ratio(found: Localization, intrinsics: Intrinsics) -> float:
    """Parallax over error of the inliers; NaN where there is no pose."""
    if not isinstance(found.far_from_near, RelativePose):
        return math.nan
    points = found.points
    far, near = points.far[points.inliers], points.near[points.inliers]
    cameras = [each.matrix for each in intrinsics.both or ()]
    return relative_parallax(found.far_from_near, far, near, *cameras)


def turned(pixels: RGBPixels, degrees: float, zoom: float) -> tuple[RGBPixels, Intrinsics]:
    """What the camera sees after it turned and zoomed, and its intrinsics."""
    height, width = pixels.shape[:2]
    far = CameraIntrinsics(FOCAL, FOCAL, width / 2, height / 2)
    near = CameraIntrinsics(zoom * FOCAL, zoom * FOCAL, width / 2, height / 2)
    rotation = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    near_from_far = np.linalg.inv(far.matrix @ rotation @ np.linalg.inv(near.matrix))
    seen = cv2.warpPerspective(pixels, near_from_far, (width, height), flags=cv2.INTER_CUBIC)
    noise = np.random.default_rng(0).normal(0, 2.5, seen.shape)
    return np.clip(seen + noise, 0, 255).astype(np.uint8), Intrinsics(far, near)


def main() -> None:
    """Localize and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kitti", type=Path)
    parser.add_argument("--sample", type=int, default=40)
    asked = parser.parse_args()
    localizer = Localizer(max_effort="points", max_false_alarms=math.inf, min_confidence=0)
    ratios: dict[str, list[float]] = {"turned": [], "KITTI": []}
    for name in PHOTOGRAPHS:
        far = np.ascontiguousarray(getattr(data, name)()[..., :3])
        for degrees in DEGREES:
            for zoom in ZOOMS:
                near, intrinsics = turned(far, degrees, zoom)
                found = localizer.localize(far, near, intrinsics=intrinsics)
                ratios["turned"].append(ratio(found, intrinsics))
    for case in sampled(find_kitti_cases(asked.kitti), asked.sample, 0):
        assert case.intrinsics is not None
        found = localizer.localize(case.far, case.near, intrinsics=case.intrinsics)
        ratios["KITTI"].append(ratio(found, case.intrinsics))
    print(f"limit {DEFAULT.acceptance.least_parallax:g}")
    for kind, values in ratios.items():
        told = np.array(values)[np.isfinite(values)]
        least, middle, most = np.percentile(told, [0, 50, 100])
        print(
            f"{kind}: {len(told)} of {len(values)}, {least:.1f} to {most:.1f}, median {middle:.1f}"
        )


if __name__ == "__main__":
    main()
