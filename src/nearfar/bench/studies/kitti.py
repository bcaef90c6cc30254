"""The KITTI Odometry study of the paper (section IV): pairs of frames and their poses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3
from nearfar.bench.datasets.cases import Case, Stereo
from nearfar.bench.figures import plot_kitti
from nearfar.bench.published import table_two
from nearfar.bench.results import Result
from nearfar.bench.study import STUDIES, Study
from nearfar.bench.summary import by_method, by_step, log_fit
from nearfar.bench.tables import MEASURES, markdown, risk_table, time_table
from nearfar.errors import BenchmarkError
from nearfar.geometry import kitti
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import Intrinsics, of_projection

STEP = 5
"""Every `STEP`-th frame is used."""
LARGEST_J = 10
"""Number of successors with which a frame is paired."""
LARGEST_ANGLE = 45.0
"""Largest difference of gaze about any axis, in degrees; other pairs are dropped."""


@dataclass(frozen=True)
class FramePair:
    """Frame `far` and its successor `near`, `j` used frames later."""

    far: int
    near: int
    j: int


def read_poses(file: Path) -> NDArray[np.float64]:
    """Read the (N, 4, 4) camera-to-world transforms of a KITTI pose file.

    Raises:
        BenchmarkError: the file cannot be read.
    """
    try:
        rows = kitti.read_transforms(file)
    except (OSError, ValueError) as error:
        raise BenchmarkError(f"pose file {file} cannot be read: {error}") from error
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows
    return poses


def read_calibration(file: Path) -> dict[str, NDArray[np.float64]]:
    """Read the (3, 4) projection matrices P0, P1, ... of a KITTI calib.txt, by name.

    Raises:
        BenchmarkError: the file cannot be read.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
        return dict(kitti.projection(line) for line in lines if line.startswith("P"))
    except (OSError, ValueError) as error:
        raise BenchmarkError(f"calibration {file} cannot be read: {error}") from error


def frame_pairs(poses: NDArray[np.float64]) -> Iterator[FramePair]:
    """Yield the pairs of a sequence whose gaze differs by at most 45 degrees about each axis."""
    used = range(0, len(poses), STEP)
    for far in used:
        for j in range(1, LARGEST_J + 1):
            near = far + j * STEP
            if near in used and np.abs(axis_angles(poses[far], poses[near])).max() <= LARGEST_ANGLE:
                yield FramePair(far, near, j)


def axis_angles(far: NDArray[np.float64], near: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3,) components of the rotation vector between two poses, in degrees.

    Other ways to split a rotation by axis do not give the known number of pairs, 41,281.
    """
    rotation_vector, _ = cv2.Rodrigues(far[:3, :3].T @ near[:3, :3])
    return np.asarray(np.degrees(rotation_vector.ravel()))


@dataclass(frozen=True)
class PairCounts:
    """Numbers of pairs of frames in some sequences.

    Attributes:
        all_pairs: pairs (i, i + j) with j = 1...10.
        within: the pairs among these whose gaze differs by at most 45 degrees about each axis.
        full_windows: the pairs among `within` whose first frame has all ten successors.
    """

    all_pairs: int
    within: int
    full_windows: int


def count_pairs(folder: Path) -> PairCounts:
    """Count the pairs of all pose files in a folder of the official layout; needs no images.

    Raises:
        BenchmarkError: the folder has no pose files, or one cannot be read.
    """
    files = sorted((folder / "poses").glob("*.txt"))
    if not files:
        raise BenchmarkError(f"there are no pose files in {folder / 'poses'}")
    all_pairs, within, full_windows = 0, 0, 0
    for file in files:
        poses = read_poses(file)
        used = len(range(0, len(poses), STEP))
        all_pairs += sum(min(LARGEST_J, used - 1 - index) for index in range(used))
        pairs = list(frame_pairs(poses))
        within += len(pairs)
        full_windows += sum(pair.far + LARGEST_J * STEP < len(poses) for pair in pairs)
    return PairCounts(all_pairs, within, full_windows)


def find_kitti_cases(folder: Path) -> list[Case]:
    """Find the pairs with images in all sequences of a folder in the official layout.

    Raises:
        BenchmarkError: there are no images, or poses or the projection of their camera are missing.
    """
    cases = [
        case
        for sequence in sorted((folder / "sequences").glob("*"))
        for case in _sequence_cases(sequence, folder / "poses" / f"{sequence.name}.txt")
    ]
    if not cases:
        raise BenchmarkError(f"there are no pairs of KITTI images in {folder / 'sequences'}")
    return cases


def _sequence_cases(sequence: Path, pose_file: Path) -> Iterator[Case]:
    number = next((n for n in (2, 0) if (sequence / f"image_{n}").is_dir()), None)
    if number is None:
        return
    poses = read_poses(pose_file)
    projections = read_calibration(sequence / "calib.txt")
    left = projections.get(f"P{number}")
    if left is None:
        raise BenchmarkError(f"calibration {sequence / 'calib.txt'} has no P{number}")
    camera = of_projection(left)
    camera_from_first = _offset(left)
    for pair in frame_pairs(poses):
        far, near = (_frame(sequence, number, frame) for frame in (pair.far, pair.near))
        if not (far.exists() and near.exists()):
            continue
        relative = (
            camera_from_first
            @ np.linalg.inv(poses[pair.far])
            @ poses[pair.near]
            @ np.linalg.inv(camera_from_first)
        )
        right, other = _frame(sequence, number + 1, pair.far), projections.get(f"P{number + 1}")
        stereo = None
        if other is not None and right.exists():
            stereo = Stereo(right, float(left[0, 3] - other[0, 3]) / camera.fx)
        yield Case(
            name=f"{sequence.name}/{pair.far:06d}-{pair.near:06d}",
            group=f"j={pair.j}",
            far=far,
            near=near,
            model="pose",
            scale_change=None,
            far_points=np.empty((0, 2)),
            near_points=np.empty((0, 2)),
            pose=RelativePose(relative[:3, :3], relative[:3, 3]),
            intrinsics=Intrinsics(camera, camera),
            stereo=stereo,
            tags={
                "sequence": sequence.name,
                "camera": number,
                "j": pair.j,
                "distance": float(np.linalg.norm(relative[:3, 3])),
            },
        )


def _frame(sequence: Path, camera: int, frame: int) -> Path:
    return sequence / f"image_{camera}" / f"{frame:06d}.png"


def _offset(projection: Matrix3) -> NDArray[np.float64]:
    """Return the (4, 4) transform from camera 0, which has poses, to a rectified camera."""
    transform = np.eye(4)
    transform[:3, 3] = np.linalg.solve(projection[:, :3], projection[:, 3])
    return transform


def step_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, the mean distance of each j and the share of each method within 5°."""
    methods = by_method(results)
    shares = [by_step(own, lambda each: float(each.strict)) for own in methods.values()]
    lines = []
    for j, distance in by_step(results, lambda each: each.distance).items():
        count = len({each.case for each in results if each.tags["j"] == j})
        cells = [f"{own[j]:.2f}" if j in own else "" for own in shares]
        lines.append([str(j), f"{distance:.1f} m", str(count), *cells])
    return markdown(["j", "mean distance", "pairs", *methods], lines)


def fit_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, the logarithmic fits of the means of each j, by method and error."""
    lines = []
    for method, own in by_method(results).items():
        distances = by_step(own, lambda each: each.distance)
        cells = []
        for measure in MEASURES:
            means = by_step(own, lambda each, name=measure: each.measures.get(name))  # type: ignore[misc]
            if len(means) < 2:
                cells.append("")
                continue
            fit = log_fit([distances[j] for j in means], list(means.values()))
            cells.append(f"{fit.a:.3f} {fit.b:+.3f} ln x")
        lines.append([method, *cells])
    return markdown(["method", *MEASURES.values()], lines)


@STUDIES.register("kitti")
class Kitti(Study):
    """Relative poses of the paper's pairs of KITTI Odometry frames."""

    def cases(self, folder: Path) -> list[Case]:
        """See `Study.cases`."""
        return find_kitti_cases(folder)

    def tables(self, results: Sequence[Result]) -> dict[str, str]:
        """See `Study.tables`."""
        limit = self.settings.max_false_alarms
        return {
            "Means over all pairs, failures counted as 1 (the paper's Table II)": (
                table_two(results).markdown()
            ),
            "Share within 5 degrees": step_table(results),
            "Fits of the group means, a + b ln(metres)": fit_table(results),
            "Share of incorrect answers, at the share of pairs answered": (
                risk_table(results, limit)
            ),
            "Median seconds by stage, where it ran": time_table(results),
        }

    def plots(self, results: Sequence[Result], folder: Path) -> list[Path]:
        """See `Study.plots`."""
        return plot_kitti(results, folder)
