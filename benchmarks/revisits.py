"""Count the queries of the study loop-closure by kind, from the poses of KITTI without its images.

python benchmarks/revisits.py KITTI
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from nearfar.bench.studies.kitti import STEP, read_poses
from nearfar.bench.studies.loop_closure import KINDS, Drive
from nearfar.bench.tables import markdown
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics

CAMERA = Intrinsics(*2 * [CameraIntrinsics(1, 1, 0, 0)])
"""No image is seen, so any camera will do."""


def kinds_of(file: Path) -> Counter[str]:
    """Return the number of queries of a drive by kind."""
    poses = read_poses(file)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    used = range(0, len(poses), STEP)
    drive = Drive(tuple(Path(str(n)) for n in used), poses[used], way[used], CAMERA)
    found: Counter[str] = Counter()
    for index in range(len(used)):
        before = drive.before(index)
        if len(before):
            found[drive.kind(index, int(before[drive.distance(index, before).argmin()]))] += 1
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kitti", type=Path)
    files = sorted((parser.parse_args().kitti / "poses").glob("*.txt"))
    counts = {file.stem: kinds_of(file) for file in files}
    counts["all"] = sum(counts.values(), Counter())
    lines = [[name, *(str(own[kind]) for kind in KINDS)] for name, own in counts.items()]
    print(markdown(["sequence", *KINDS], lines))


if __name__ == "__main__":
    main()
