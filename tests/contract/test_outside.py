"""Plug-ins of other packages on the command line: by their place, and by an entry point."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import KnownPair
from tests.contract.distribution import (
    nearfar,
    write_entry_points,
    write_modules,
    write_two_pairs,
)

PLUGINS = '''
import numpy as np

from nearfar.descriptors import DESCRIPTORS
from nearfar.estimators import ESTIMATORS
from nearfar.exports import EXPORTERS, Exporter
from nearfar.methods import METHODS
from nearfar.methods.points import Combination
from nearfar.proposals import PROPOSERS


@ESTIMATORS.register("careful")
class Careful:
    """MAGSAC++ with a small threshold."""

    def __init__(self, name, settings):
        self._inner = ESTIMATORS.create("magsac", settings.replace(inlier_threshold=0.5))

    def estimate(self, far, near, task):
        return self._inner.estimate(far, near, task)


class Careless(Careful):
    def estimate(self, far, near, task):
        return self._inner.estimate(far[1:], near[1:], task)


@EXPORTERS.register("count")
class Count(Exporter):
    file_name = "count.txt"

    def write(self, subject, path):
        path.write_text(f"{len(subject.localization.points)} matches")
        return [path]


@METHODS.register("mine")
class Mine(Combination):
    def __init__(self, name, settings):
        super().__init__("sift-tuned", settings)


@PROPOSERS.register("grid")
class Grid:
    """Squares of 80 pixels, every 40 pixels."""

    def __init__(self, name, settings):
        pass

    def propose(self, pixels):
        height, width = pixels.shape[:2]
        x, y = np.meshgrid(np.arange(0, width - 79, 40), np.arange(0, height - 79, 40))
        return np.array([(*each, 80, 80) for each in zip(x.flat, y.flat)], np.int32)


@DESCRIPTORS.register("colours")
class Colours:
    """The mean colours of 4x4 parts, against the mean of all."""

    dimensions = 48

    def __init__(self, name, settings):
        pass

    def describe(self, pixels, boxes):
        rows = []
        for x, y, width, height in boxes:
            part = pixels[y : y + height, x : x + width].astype(np.float32)
            cells = [cell.mean(axis=(0, 1)) for row in np.array_split(part, 4) for cell in
                     np.array_split(row, 4, axis=1)]
            row = np.concatenate(cells) - part.mean()
            rows.append(row / max(np.linalg.norm(row), 1e-6))
        return np.array(rows, np.float32).reshape(-1, 48)
'''

POINTS = '''
"""A detector and a matcher in one file."""

import cv2
import numpy as np

from nearfar.features import DETECTORS, MATCHERS
from nearfar.features.keypoints import Keypoints


@DETECTORS.register("kaze")
class Kaze:
    def __init__(self, name, settings):
        self._kaze = cv2.KAZE_create()

    def detect(self, pixels):
        grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
        keypoints, descriptors = self._kaze.detectAndCompute(grey, None)
        return Keypoints.of([each.pt for each in keypoints], descriptors)


@MATCHERS.register("lowe")
class Lowe:
    def __init__(self, name, settings):
        self._matcher = cv2.BFMatcher()

    def match(self, far, near):
        found = self._matcher.knnMatch(far.descriptors, near.descriptors, k=2)
        good = [one for one, other in found if one.distance < 0.7 * other.distance]
        return np.array([(match.queryIdx, match.trainIdx) for match in good])


class Beyond(Lowe):
    def match(self, far, near):
        return super().match(far, near) + len(far)


class NoKeypoints(Kaze):
    def detect(self, pixels):
        return super().detect(pixels).xy
'''


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder for PYTHONPATH that holds the plug-ins."""
    return write_modules(tmp_path / "site", {"mine_plugins": PLUGINS, "mine_points": POINTS})


@pytest.fixture
def installed(package: Path) -> Path:
    """The same folder, as a distribution with entry points."""
    return write_entry_points(package, "mine", ["mine_plugins", "mine_points"])


@pytest.mark.parametrize(
    ("method", "export"),
    [("mine", "count"), ("python:mine_plugins.Mine", "python:mine_plugins.Count")],
)
def test_method_and_exporter(
    method: str, export: str, installed: Path, known_files: tuple[Path, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    ran = nearfar(
        installed, "localize", *known_files, "--method", method, "--save", out, "--export", export
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads((out / "localization.json").read_text())["method"] == method
    assert (out / "count.txt").read_text().endswith(" matches")


@pytest.mark.parametrize("estimator", ["careful", "python:mine_plugins.Careful"])
def test_estimator(estimator: str, installed: Path, known_files: tuple[Path, Path]) -> None:
    options = ["--method", "sift-ratio", "--json"]
    ran = nearfar(installed, "localize", *known_files, *options, "--estimator", estimator)
    own = nearfar(installed, "localize", *known_files, *options, "--estimator", "magsac")
    assert ran.returncode == own.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["status"] == "localized"
    assert json.loads(ran.stdout)["inliers"] != json.loads(own.stdout)["inliers"]


@pytest.mark.parametrize("prefix", ["", "python:mine_points."])
def test_detector_and_matcher(
    prefix: str, installed: Path, known_files: tuple[Path, Path], known_pair: KnownPair
) -> None:
    """One file adds both; they are used by name and by place, alone and with nearfar's own."""
    names = ("Kaze", "Lowe") if prefix else ("kaze", "lowe")
    detector, matcher = ["--detector", prefix + names[0]], ["--matcher", prefix + names[1]]
    for options in ([*detector, *matcher], detector, matcher):
        arguments = [*known_files, "--method", "points", *options, "--json"]
        ran = nearfar(installed, "localize", *arguments)
        assert ran.returncode == 0, ran.stderr
        found = json.loads(ran.stdout)
        assert known_pair.error(np.array(found["far_from_near"]["homography"])) < 3


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--matcher", "python:mine_points.Beyond"], "the matcher Beyond must return an array (K"),
        (["--detector", "python:mine_points.NoKeypoints"], "the detector NoKeypoints must return"),
        (["--detector", "kase"], "did you mean 'kaze'?"),
    ],
)
def test_a_wrong_detector_or_matcher_is_one_line(
    option: list[str], message: str, installed: Path, known_files: tuple[Path, Path]
) -> None:
    ran = nearfar(installed, "localize", *known_files, "--method", "points", *option)
    assert ran.returncode == 2
    assert message in " ".join(ran.stderr.split())
    assert "Traceback" not in ran.stderr


@pytest.mark.parametrize(
    ("descriptor", "proposer"),
    [("colours", "grid"), ("python:mine_plugins.Colours", "python:mine_plugins.Grid")],
)
def test_descriptor_and_proposer(
    descriptor: str, proposer: str, installed: Path, known_files: tuple[Path, Path]
) -> None:
    options = ["--method", "objects", "--json", "--descriptor", descriptor, "--proposer", proposer]
    ran = nearfar(installed, "localize", *known_files, *options)
    assert ran.returncode in (0, 3), ran.stderr
    found = json.loads(ran.stdout)
    assert found["descriptor"] == descriptor
    assert found["landmark_matches"] > 10


def test_a_wrong_number_of_flags_is_one_line(
    installed: Path, known_files: tuple[Path, Path]
) -> None:
    options = ["--method", "sift-ratio", "--estimator", "python:mine_plugins.Careless"]
    ran = nearfar(installed, "localize", *known_files, *options)
    assert ran.returncode == 2
    assert "return one flag for each pair of points" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_workers_know_them(installed: Path, known_files: tuple[Path, Path], tmp_path: Path) -> None:
    pairs = write_two_pairs(tmp_path / "pairs", *known_files)
    out = tmp_path / "run"
    options = ["--method", "mine", "--jobs", "2", "--out", out]
    ran = nearfar(installed, "bench", "pairs", pairs, *options)
    assert ran.returncode == 0, ran.stderr
    rows = [json.loads(line) for line in (out / "pairs.jsonl").read_text().splitlines()]
    assert [row["status"] for row in rows] == ["localized", "localized"]


def test_list_names_them(installed: Path) -> None:
    ran = nearfar(installed, "list")
    assert ran.returncode == 0
    names = {"mine", "count", "careful", "grid", "colours", "kaze", "lowe"}
    assert names <= set(ran.stdout.split())


def test_a_broken_one_is_one_line(installed: Path) -> None:
    (installed / "mine_plugins.py").write_text("import missing_module_of_mine")
    ran = nearfar(installed, "list")
    assert ran.returncode == 2
    assert "the plug-in 'mine_plugins' (mine_plugins) cannot be imported" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_without_an_entry_point_a_name_is_unknown(
    package: Path, known_files: tuple[Path, Path]
) -> None:
    ran = nearfar(package, "localize", *known_files, "--method", "mine")
    assert ran.returncode == 2
    assert "unknown method 'mine'" in ran.stderr
