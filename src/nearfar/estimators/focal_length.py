"""The focal length that two images of one camera share, from their matches."""

import numpy as np
import poselib

from nearfar.arrays import Coordinates

LEAST_MATCHES = 20
"""Least number of inliers from which a focal length is told."""
UNIT = 1000.0
"""Length that the diagonal of each image is scaled to, so that images may have two sizes."""
PLAUSIBLE = (0.3, 30.0)
"""Range of focal lengths in diagonals: from a lens of 13 mm to one of 1,300 mm on 35 mm film."""
PARTS = 9
"""Number of random halves of the inliers, from which the focal length is estimated again."""
SPREAD = 0.025
"""Largest deviation among the halves, as a share of the focal length, of one that is told. Below it
the focal length was within 3 %; above it, up to 15 % off. Parallel axes leave it open: 0.5."""
LEAST_SAMPLES = 100
"""Least samples of six matches that are drawn of a half: its matches are inliers already."""
MAX_ITERATIONS = 20_000
"""Most samples of six matches that are drawn."""


def shared_focal_length(
    far: Coordinates,
    near: Coordinates,
    far_size: tuple[int, int],
    near_size: tuple[int, int],
    threshold: float,
    seed: int,
) -> float | None:
    """Estimate the focal length of two images that one camera took without zooming.

    The principal points are taken to be the middles of the images.

    Args:
        far: (N, 2) points of the far image, in its pixels.
        near: (N, 2) points of the near image that they match.
        far_size: width and height of the far image in pixels.
        near_size: width and height of the near image; it may be resized.
        threshold: largest epipolar distance of an inlier, in far pixels.
        seed: of the random samples.

    Returns:
        The focal length as a share of the diagonal of an image; None where the matches leave it
        open, as they do where the axes of the cameras are parallel.
    """
    first, second = _scaled(near, near_size), _scaled(far, far_size)
    options = {
        "max_epipolar_error": threshold * UNIT / float(np.hypot(*far_size)),
        "max_iterations": MAX_ITERATIONS,
        "seed": seed,
    }
    if len(first) < LEAST_MATCHES:
        return None
    pair, info = poselib.estimate_shared_focal_relative_pose(first, second, (0, 0), options)
    inliers = np.flatnonzero(info["inliers"])
    found = _focal(pair)
    if len(inliers) < LEAST_MATCHES or not PLAUSIBLE[0] <= found <= PLAUSIBLE[1]:
        return None
    random = np.random.default_rng(seed)
    halves = []
    for _ in range(PARTS):
        half = random.choice(inliers, len(inliers) // 2, replace=False)
        again, _ = poselib.estimate_shared_focal_relative_pose(
            first[half], second[half], (0, 0), {**options, "min_iterations": LEAST_SAMPLES}
        )
        halves.append(_focal(again))
    deviation = float(np.median(np.abs(np.array(halves) / found - 1)))
    return found if deviation <= SPREAD else None


def _scaled(points: Coordinates, size: tuple[int, int]) -> Coordinates:
    """Return points from the middle of their image, of which the diagonal is `UNIT`."""
    middle = (np.array(size) - 1) / 2
    return np.asarray((points - middle) * (UNIT / np.hypot(*size)), np.float64)


def _focal(pair: poselib.ImagePair) -> float:
    """Return the focal length of PoseLib's pair of images, in diagonals."""
    return float(pair.camera1.params[0]) / UNIT
