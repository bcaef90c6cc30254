"""The sweep: shared features equal plain ones, in little memory; resuming; missing weights."""

import errno
import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save_file

from nearfar.arrays import Boxes, RGBPixels
from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.runner import run
from nearfar.bench.studies.kitti import find_kitti_cases
from nearfar.bench.studies.sweep import Grid, first_pairs, run_sweep
from nearfar.bench.studies.sweep_scores import scores, sweep_tables
from nearfar.bench.studies.tap_features import TapFeatures, VectorFile, taps_of
from nearfar.cli import main
from nearfar.errors import BenchmarkError, SettingsError, WeightsError
from nearfar.features.feature_map import unit_rows
from nearfar.landmarks import Landmarks, match_landmarks
from nearfar.methods.paper import Paper
from nearfar.runtime.timing import StageTimer
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.rows import Row, read_rows
from tests.bench.test_run import write_pair
from tests.conftest import KnownPair
from tests.descriptors.test_squeezenet import FIRES

SUM = "squeezenet-fire4@32+squeezenet-fire9@64"
GIGABYTE = 10**9


@pytest.fixture(scope="module")
def random_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Enough to compare ways to compute the same; no accuracy can be told from them."""
    rng = np.random.default_rng(0)
    tensors: dict[str, NDArray[np.float32]] = {}

    def draw(name: str, *shape: int) -> None:
        deviation = np.sqrt(2 / np.prod(shape[1:]))
        tensors[f"{name}.weight"] = rng.normal(0, deviation, shape).astype(np.float32)
        tensors[f"{name}.bias"] = rng.random(shape[0], np.float32)

    draw("features.0", 96, 3, 7, 7)
    for name, (channels, squeezed, expanded) in FIRES.items():
        draw(f"{name}.squeeze", squeezed, channels, 1, 1)
        draw(f"{name}.expand1x1", expanded, squeezed, 1, 1)
        draw(f"{name}.expand3x3", expanded, squeezed, 3, 3)
    path = tmp_path_factory.mktemp("weights") / "squeezenet.safetensors"
    save_file(tensors, path)
    return path


@pytest.fixture
def settings(random_weights: Path) -> Settings:
    """Few boxes, so that tests are quick."""
    return Settings(
        weights={"squeezenet": random_weights}, proposal_min_area=8000, max_false_alarms=1e9
    )


@pytest.mark.parametrize("descriptor", ["squeezenet-fire4@32", "squeezenet-fire9@64", SUM])
def test_shared_features_are_those_of_the_plain_method(
    descriptor: str, settings: Settings, photograph: Callable[[str], RGBPixels], tmp_path: Path
) -> None:
    """With several outputs ONNX Runtime may fuse other operations, hence the tolerance."""
    taps = taps_of("squeezenet-fire2@32+squeezenet-fire5@64+" + SUM)
    shared = TapFeatures(taps, settings, tmp_path, GIGABYTE)
    image, timer = photograph("chelsea"), StageTimer()
    expected = Paper("paper", settings.replace(descriptor=descriptor)).extract(image, timer)
    for _ in range(2):
        found = shared.extract(image, taps_of(descriptor), timer)
        np.testing.assert_array_equal(found.points.xy, expected.points.xy)
        for ours, plain in zip(found.landmarks.layers, expected.landmarks.layers, strict=True):
            np.testing.assert_array_equal(ours.boxes, plain.boxes)
            np.testing.assert_allclose(
                ours.vectors.astype(np.float32), plain.vectors.astype(np.float32), atol=1e-3
            )
    assert list(tmp_path.iterdir()) == []


class Noise:
    """Stands for a network: vectors that depend on the box alone."""

    dimensions = (50_000, 20_000)

    def __init__(self) -> None:
        self.described = 0

    def describe(self, pixels: RGBPixels, boxes: Boxes) -> list[NDArray[np.float16]]:  # noqa: ARG002
        self.described += len(boxes)
        return [
            unit_rows(
                np.stack(
                    [
                        np.random.default_rng(box[0]).random(length, np.float32) - 0.5
                        for box in boxes
                    ]
                )
            )
            for length in self.dimensions
        ]


def test_streamed_matches_equal_direct_ones_in_bounded_memory(tmp_path: Path) -> None:
    """300 boxes of 70,000 values, 42 MB an image; 5 boxes at a time."""
    pixels = np.zeros((1, 1, 3), np.uint8)
    far_boxes = np.arange(1200, dtype=np.int32).reshape(300, 4)
    near_boxes = far_boxes[::-1][:200]
    noise = Noise()
    tracemalloc.start()
    far = VectorFile(noise, pixels, far_boxes, tmp_path, 5)
    near = VectorFile(noise, pixels, near_boxes, tmp_path, 5)
    streamed = [
        match_landmarks(
            Landmarks(far_boxes, far.vectors(output)), Landmarks(near_boxes, near.vectors(output))
        )
        for output in (0, 1)
    ]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert far.nbytes == 42_000_000
    assert peak < far.nbytes / 2
    assert noise.described == 500
    for output, matches in enumerate(streamed):
        direct = match_landmarks(
            Landmarks(far_boxes, noise.describe(pixels, far_boxes)[output]),
            Landmarks(near_boxes, noise.describe(pixels, near_boxes)[output]),
        )
        assert len(matches) >= 200
        for name in ("far_boxes", "near_boxes", "similarity"):
            np.testing.assert_array_equal(getattr(matches, name), getattr(direct, name))


def test_no_boxes_have_no_vectors(tmp_path: Path) -> None:
    empty = VectorFile(
        Noise(), np.zeros((1, 1, 3), np.uint8), np.empty((0, 4), np.int32), tmp_path, 5
    )
    assert empty.vectors(1).shape == (0, 20_000)


@pytest.fixture
def case(known_pair: KnownPair, tmp_path: Path) -> Case:
    write_pair(tmp_path / "pairs" / "one", known_pair)
    return find_pairs(tmp_path / "pairs")[0]


def test_a_sweep_resumes(case: Case, settings: Settings, tmp_path: Path) -> None:
    grid = Grid("squeezenet", ("fire4", "fire9"), (64, 32), (SUM,))
    file = tmp_path / "out" / "sweep_pairs.jsonl"
    results = run_sweep([case], grid, settings, file, disk_bytes=0)
    names = [row["descriptor"] for row in read_rows(file)]
    assert names == grid.descriptors
    assert names[:3] == ["squeezenet-fire4@64", "squeezenet-fire9@64", "squeezenet-fire4@32"]
    assert names[4] == SUM
    whole = file.read_bytes()
    lines = whole.splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:2]) + lines[2][:30])
    assert run_sweep([case], grid, settings, file, disk_bytes=0) == results
    assert without_seconds(read_rows(file)) == without_seconds([json.loads(line) for line in lines])
    assert sorted(path.suffix for path in file.parent.iterdir()) == [".json", ".jsonl"]


def test_rows_with_errors_are_retried_and_counted(
    case: Case, settings: Settings, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grid = Grid("squeezenet", ("fire4",), (32,), methods=("paper", "objects"))
    file, image = tmp_path / "out" / "sweep_pairs.jsonl", case.near.read_bytes()
    case.near.write_bytes(b"no image")
    run_sweep([case], grid, settings, file, disk_bytes=0)
    assert [row["status"] for row in read_rows(file)] == ["error", "error"]
    case.near.write_bytes(image)
    run_sweep([case], grid, settings, file, disk_bytes=0)
    assert "reused 0 rows" in capsys.readouterr().err
    rows = read_rows(file)
    assert [row["status"] == "error" for row in rows] == [True, True, False, False]
    assert {row["data"] for row in rows[2:]} == {case.content_hash()}
    runs = json.loads((file.parent / "run.json").read_text())["runs"]
    assert [(each["failed"], each["skipped"]) for each in runs] == [(1, 0), (0, 0)]
    run_sweep([case], grid, settings, file, disk_bytes=0)
    assert "reused 2 rows" in capsys.readouterr().err
    assert read_rows(file) == rows


def test_a_full_disk_ends_a_sweep_without_a_row(
    case: Case, settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(VectorFile, "__init__", full)
    file = tmp_path / "sweep_pairs.jsonl"
    with pytest.raises(OSError, match="No space left"):
        run_sweep([case], Grid("squeezenet", ("fire4",), (32,)), settings, file, disk_bytes=0)
    assert read_rows(file) == []


def test_workers_find_the_same(known_pair: KnownPair, settings: Settings, tmp_path: Path) -> None:
    for name in ("one", "two", "three"):
        write_pair(tmp_path / "pairs" / name, known_pair)
    cases, grid = find_pairs(tmp_path / "pairs"), Grid("squeezenet", ("fire4",), (64, 32))
    found = []
    for jobs in (1, 2):
        file = tmp_path / str(jobs) / "sweep_pairs.jsonl"
        run_sweep(cases, grid, settings, file, disk_bytes=GIGABYTE, workers=Workers(jobs))
        rows = sorted(read_rows(file), key=lambda row: (row["case"], row["descriptor"]))
        found.append(without_seconds(rows))
        assert len(rows) == 6
    assert found[0] == found[1]


def without_seconds(rows: list[Row]) -> list[Row]:
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


def test_nothing_is_run_without_weights(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEARFAR_CACHE", str(tmp_path / "cache"))
    grid = Grid("resnet50")
    assert len(grid.descriptors) == 24
    file = tmp_path / "sweep_pairs.jsonl"
    results = run_sweep([case], grid, Settings(), file, disk_bytes=0)
    assert {(each.status, each.reason, each.strict) for each in results} == {
        ("not run", "weights", None)
    }
    assert read_rows(file) == []
    assert sweep_tables(results).count("not run: weights") == 24
    named = Settings(weights={"resnet50": tmp_path / "missing.pth"})
    with pytest.raises(WeightsError, match="missing.pth"):
        run_sweep([case], grid, named, file, disk_bytes=0)


def row(case: str, ste: float, status: str = "localized") -> Row:
    good = ste < 30
    columns = {"model": "homography", "method": "paper", "strict": good, "loose": good}
    return {"case": case, "ste": ste, "status": status} | columns


def test_scores_by_hand() -> None:
    e = float(np.e)
    rows = {
        ("paper", "a"): [row("s/one", e), row("s/two", e**4), row("s/three", e**9, "failed")],
        ("objects", "a"): [row("s/one", e**2), row("s/two", e**4), row("s/three", e**6)],
    }
    configurations = [*rows, ("paper", "b")]
    paper, objects, missing = scores("pairs", rows, configurations, 3)
    assert (paper.strict, paper.failures, paper.wins) == (1, 1, 2)
    assert (objects.strict, objects.failures, objects.wins) == (1, 0, 2)
    mean = paper.means["mean ln STE"]
    assert mean.value == pytest.approx(14 / 3)
    assert mean.low < mean.value < mean.high
    assert missing.status == "not run"
    lines = sweep_tables([paper, objects, missing]).splitlines()
    assert lines[0] == "| pairs | descriptor | strict, % | mean ln STE | failures | wins |"
    assert lines[2].startswith("| paper | a | 1 of 3: 33 (6 to 79) | 4.667 (1.000 to 9.000)")
    assert lines[2].endswith("| 1 | 2 |")
    assert "not run: weights" in lines[4]


def test_a_pose_is_scored_by_its_rotation() -> None:
    own = [{"case": "00/1-2", "model": "pose", "r_err": 0.2, "t_err_unit": 0.7, "method": "paper"}]
    rows = {("paper", "a"): [each | {"status": "localized"} for each in own]}
    (score,) = scores("kitti", rows, list(rows), 1)
    assert {name: each.value for name, each in score.means.items()} == {
        "t_err, unit length": 0.7,
        "r_err": 0.2,
    }
    assert score.wins == 1


@pytest.mark.parametrize(
    "wrong",
    [("vgg",), ("resnet50", ("fire2",)), ("resnet50", (), (65,)), ("resnet50", (), (), ("hog",))],
)
def test_unknown_configurations_are_refused(wrong: tuple[str]) -> None:
    with pytest.raises(SettingsError, match="network"):
        Grid(*wrong)


def test_the_first_pairs_of_a_sequence(case: Case) -> None:
    with pytest.raises(BenchmarkError, match="07"):
        first_pairs([case], "07", 1)


def test_the_command_needs_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "sweep", "--out", str(tmp_path)]) == 2
    assert "--pairs" in capsys.readouterr().err


def test_real_weights_give_the_rows_of_method_paper(extra_data: Path, tmp_path: Path) -> None:
    weights = extra_data / "weights" / "squeezenet1_0_deepcomp.safetensors"
    settings = Settings(weights={"squeezenet": weights}, max_false_alarms=float("inf"))
    cases = first_pairs(find_kitti_cases(extra_data / "kitti"), "00", 1)
    grid = Grid("squeezenet", ("fire5",), (64,))
    file = tmp_path / "sweep.jsonl"
    results = run_sweep(cases, grid, settings, file, disk_bytes=GIGABYTE)
    variant = settings.replace(method="paper", descriptor="squeezenet-fire5@64")
    plain = run(cases, [variant], tmp_path / "plain.jsonl")
    swept = [row for row in read_rows(file) if row["descriptor"] == variant.descriptor]
    for ours, theirs in zip(swept, [each.row for each in plain], strict=True):
        assert ours["settings"] == theirs["settings"]
        assert ours["landmark_matches"] == pytest.approx(theirs["landmark_matches"], abs=2)
        assert ours["strict"] == theirs["strict"]
    assert results[0].strict is not None
    assert results[0].strict >= 1
