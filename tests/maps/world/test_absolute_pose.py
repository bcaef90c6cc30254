"""The covariance of a pose covers its error."""

import numpy as np
from scipy.spatial.transform import Rotation

from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.maps.world.absolute_pose import absolute_pose
from nearfar.maps.world.scene import ScenePoints

CAMERA = CameraIntrinsics(700, 700, 400.0, 280.0)
TRIALS, NOISE = 60, 1.0


def test_errors_are_as_large_as_the_covariance_says() -> None:
    rng = np.random.default_rng(0)
    rotation = Rotation.from_rotvec([0.3, -1.2, 0.4])
    centre = np.array([40.0, -7.0, 3.0])
    squared = []
    for _ in range(TRIALS):
        seen = rng.uniform([-3, -2, 6], [3, 2, 14], (80, 3))
        points = rotation.apply(seen) + centre
        pixels = (seen @ CAMERA.matrix.T)[:, :2] / seen[:, 2:]
        scene = ScenePoints(pixels + rng.normal(0, NOISE, pixels.shape), points)
        found = absolute_pose(scene, CAMERA, 1.0, 6 * NOISE, 0)
        assert found is not None
        turn = (rotation * Rotation.from_matrix(found.rotation).inv()).as_rotvec()
        off = np.concatenate([turn, centre - found.centre])
        squared.append(off @ np.linalg.solve(found.covariance, off) / 6)
    assert 0.75 < np.mean(squared) < 1.35
