"""Features on disk: equality, damage, concurrency, kill -9, full disks and eviction."""

import dataclasses
import errno
import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.features.keypoints import Keypoints
from nearfar.landmarks import Landmarks
from nearfar.localizer import Localizer
from nearfar.methods.points import PointMethod
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings
from nearfar.storage import feature_store
from nearfar.storage.feature_store import FeatureStore, flattened, settings_hash
from tests.conftest import KnownPair


def points(seed: int, count: int = 50) -> Keypoints:
    rng = np.random.default_rng(seed)
    return Keypoints.of(rng.normal(size=(count, 2)), rng.random((count, 128), np.float32))


def never() -> Keypoints:
    raise AssertionError("the features were computed again")


class Compute:
    """Returns features and counts how often."""

    def __init__(self, features: Keypoints) -> None:
        self.features = features
        self.calls = 0

    def __call__(self) -> Keypoints:
        self.calls += 1
        return self.features


def assert_same(left: Any, right: Any) -> None:
    """Equal to the bit, with the same element types and shapes."""
    for name, array in flattened(left).items():
        other = flattened(right)[name]
        assert (array.dtype, array.shape) == (other.dtype, other.shape)
        assert array.tobytes() == other.tobytes()


@dataclasses.dataclass(frozen=True, eq=False)
class Nested:
    """Stands for the features of a method; its module is made to look like one of the package."""

    landmarks: tuple[Landmarks, ...]
    points: Keypoints
    scale: float
    note: str | None = None


@pytest.fixture
def nested(monkeypatch: pytest.MonkeyPatch) -> Nested:
    monkeypatch.setattr("nearfar.features.keypoints.Nested", Nested, raising=False)
    monkeypatch.setattr(Nested, "__module__", "nearfar.features.keypoints")
    rng = np.random.default_rng(1)
    boxes = rng.integers(0, 99, (7, 4)).astype(np.int32)
    halves = rng.normal(size=(7, 9)).astype(np.float16)
    halves[0, :3] = [np.nan, np.inf, -0.0]
    empty = Landmarks(np.empty((0, 4), np.int32), np.empty((0, 9), np.float16))
    return Nested((Landmarks(boxes, halves), empty), points(2), 0.1 + 0.2)


def test_what_comes_back_is_equal_to_the_bit(nested: Nested, tmp_path: Path) -> None:
    store = FeatureStore(tmp_path)
    assert store.get_or_compute("key", lambda: nested) is nested
    again: Any = FeatureStore(tmp_path).get_or_compute("key", never)
    assert_same(again, nested)
    assert (again.scale, again.note) == (nested.scale, None)
    assert [len(each.boxes) for each in again.landmarks] == [7, 0]


def test_other_objects_are_refused(tmp_path: Path) -> None:
    store = FeatureStore(tmp_path)
    odd = dataclasses.replace(points(0), xy=np.array([None]))
    for wrong in (odd, object(), [1]):
        with pytest.raises(TypeError, match="cannot be stored"):
            store.get_or_compute("key", itertools.repeat(wrong).__next__)
    assert list(tmp_path.iterdir()) == []


def test_a_file_cannot_name_a_foreign_class(tmp_path: Path) -> None:
    text = '{"class": ["subprocess", "Popen"], "fields": {"args": {"value": "false"}}}'
    np.savez(tmp_path / "key.npz", structure=np.array(text))
    made = points(0)
    assert FeatureStore(tmp_path).get_or_compute("key", lambda: made) is made


def damaged(content: bytes) -> list[bytes]:
    """Cut short at many lengths, and with one byte changed at many places."""
    step = max(1, len(content) // 60)
    cuts = [content[:length] for length in range(0, len(content), step)]
    changed = []
    for place in range(0, len(content), step):
        copy = bytearray(content)
        copy[place] ^= 0x55
        changed.append(bytes(copy))
    return cuts + changed


def test_a_damaged_file_is_absent_or_right(tmp_path: Path) -> None:
    """A byte of an archive's bookkeeping may change without any effect on what is read."""
    store, original = FeatureStore(tmp_path), points(0, count=3)
    store.get_or_compute("key", lambda: original)
    file = tmp_path / "key.npz"
    whole = file.read_bytes()
    recomputed = 0
    for content in damaged(whole):
        file.write_bytes(content)
        compute = Compute(original)
        assert_same(store.get_or_compute("key", compute), original)
        recomputed += compute.calls
        if compute.calls:
            assert file.read_bytes() == whole
    assert recomputed > 90


def hammer(folder: Path, seed: int) -> None:
    """Read and rewrite the same few files, deleting one now and then."""
    store = FeatureStore(folder)
    for turn in range(60):
        key = turn % 3
        expected = points(key)
        assert_same(store.get_or_compute(str(key), Compute(expected)), expected)
        if turn % 7 == seed:
            (folder / f"{key}.npz").unlink(missing_ok=True)


def test_concurrent_writers(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=hammer, args=(tmp_path, seed)) for seed in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join(60)
    assert [writer.exitcode for writer in writers] == [0] * 4
    assert {file.suffix for file in tmp_path.iterdir()} == {".npz"}


WRITER = """
import sys
from pathlib import Path
import numpy as np
from nearfar.features.keypoints import Keypoints
from nearfar.storage.feature_store import FeatureStore
store = FeatureStore(Path(sys.argv[1]), 10**9)
made = Keypoints.of(np.zeros((200_000, 2)), np.ones((200_000, 128), np.float32))
print("ready", flush=True)
while True:
    (store.folder / "key.npz").unlink(missing_ok=True)
    store.get_or_compute("key", lambda: made)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_writer_killed_in_the_middle(tmp_path: Path) -> None:
    """Killed while a half written file of 100 MB is there; the store goes on and cleans up."""
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"ready\n"
        while not any(half_written(tmp_path)):
            time.sleep(0.001)
        writer.send_signal(signal.SIGKILL)
    made = points(0)
    found = FeatureStore(tmp_path).get_or_compute("key", lambda: made)
    assert found is made or len(found.xy) == 200_000
    for left in tmp_path.glob("*.incomplete"):
        os.utime(left, (1, 1))
    FeatureStore(tmp_path).get_or_compute("another", lambda: made)
    assert {file.suffix for file in tmp_path.iterdir()} == {".npz"}


def half_written(folder: Path) -> list[Path]:
    return [file for file in folder.glob("*.incomplete") if 0 < file.stat().st_size < 10**8]


@pytest.mark.parametrize("function", ["os.fsync", "os.replace", "tempfile.mkstemp"])
def test_a_full_disk_does_not_end_a_run(
    function: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    store, made = FeatureStore(tmp_path), points(0)
    with monkeypatch.context() as patched:
        patched.setattr(function, full)
        assert store.get_or_compute("key", lambda: made) is made
    assert list(tmp_path.iterdir()) == []
    store.get_or_compute("key", lambda: made)
    assert_same(store.get_or_compute("key", never), made)


def test_nothing_is_stored_on_an_almost_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10**8}))
    FeatureStore(tmp_path).get_or_compute("key", lambda: points(0))
    assert list(tmp_path.iterdir()) == []


def test_what_was_used_longest_ago_goes_first(tmp_path: Path) -> None:
    size = sum(array.nbytes for array in flattened(points(0)).values())
    store = FeatureStore(tmp_path, max_bytes=4 * size)
    ages = itertools.count(1)
    for key in "abcd":
        store.get_or_compute(key, lambda: points(0))
        age = next(ages)
        os.utime(tmp_path / f"{key}.npz", (age, age))
        if key == "c":
            store.get_or_compute("a", never)
    assert {file.stem for file in tmp_path.iterdir()} == {"a", "c", "d"}
    store.get_or_compute("huge", lambda: points(0, count=1000))
    assert {file.stem for file in tmp_path.iterdir()} == {"a", "c", "d"}


def test_the_size_stays_within_the_limit(tmp_path: Path) -> None:
    store = FeatureStore(tmp_path, max_bytes=10**6)
    for key in range(80):
        store.get_or_compute(str(key), lambda: points(0))
        assert sum(file.stat().st_size for file in tmp_path.iterdir()) <= 10**6


@dataclasses.dataclass(frozen=True, kw_only=True)
class Extended(Settings):
    """Settings with a field that the store cannot know."""

    new: int = 1


def test_every_setting_makes_other_features_unless_it_is_named(tmp_path: Path) -> None:
    assert settings_hash(Settings()) == settings_hash(Settings())
    assert settings_hash(Extended()) != settings_hash(Extended(new=2))
    assert settings_hash(Settings()) != settings_hash(Settings(method="sift"))
    assert settings_hash(Settings()) != settings_hash(Settings(proposal_sigma=0.8))
    assert settings_hash(Settings()) != settings_hash(Settings(detector="orb"))
    finer = replace(DEFAULT, points=replace(DEFAULT.points, contrast=0.01))
    assert settings_hash(Settings()) != settings_hash(Settings(constants=finer))
    stricter = replace(DEFAULT, zoom=replace(DEFAULT.zoom, ratio=0.8))
    assert settings_hash(Settings()) == settings_hash(Settings(constants=stricter))
    same = Settings(matcher="mnn", inlier_threshold=1, max_false_alarms=1, seed=3, batch_size=2)
    assert settings_hash(Settings()) == settings_hash(same)
    for name, content in (("one", b"a"), ("copy", b"a"), ("two", b"b")):
        (tmp_path / name).write_bytes(content)
    one, copy, two = (
        settings_hash(Settings(weights={"resnet50": tmp_path / name}))
        for name in ("one", "copy", "two")
    )
    assert one == copy != two


def test_another_shipped_network_makes_other_features(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feature_store, "_PACKAGE", tmp_path)
    found = set()
    for content in (b"one", b"two"):
        (tmp_path / "network.onnx").write_bytes(content)
        feature_store.code_hash.cache_clear()
        found.add(settings_hash(Settings()))
    feature_store.code_hash.cache_clear()
    assert len(found) == 2


@pytest.mark.parametrize(
    ("source", "same"),
    [
        ("def f():\n    _log.warning('other words')\n    raise ValueError('b')\n", True),
        (
            "def f():\n    # A comment.\n    _log.warning('words')\n    raise ValueError('a')\n",
            True,
        ),
        ("def f():\n    _log.warning('words')\n    raise KeyError('a')\n", False),
        ("def f():\n    _log.warning('words')\n    return 1\n", False),
    ],
)
def test_words_are_no_part_of_the_code(
    source: str, same: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feature_store, "_PACKAGE", tmp_path)
    found = set()
    for content in ("def f():\n    _log.warning('words')\n    raise ValueError('a')\n", source):
        (tmp_path / "module.py").write_text(content)
        feature_store.code_hash.cache_clear()
        found.add(settings_hash(Settings()))
    feature_store.code_hash.cache_clear()
    assert (len(found) == 1) == same


def test_a_localizer_computes_features_once_for_all_runs(
    known_pair: KnownPair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(method="sift")
    plain = Localizer(settings).localize(known_pair.far, known_pair.near)
    calls: list[object] = []
    extract = PointMethod.extract

    def counted(method: PointMethod, pixels: RGBPixels, timer: StageTimer) -> Any:
        calls.append(pixels)
        return extract(method, pixels, timer)

    monkeypatch.setattr(PointMethod, "extract", counted)
    for _ in range(2):
        localizer = Localizer(settings, store=FeatureStore(tmp_path))
        found = localizer.localize(known_pair.far, known_pair.near)
        np.testing.assert_array_equal(found.far_from_near, plain.far_from_near)
    assert len(calls) == 2
    other = Localizer(settings.replace(max_size=300), store=FeatureStore(tmp_path))
    other.localize(known_pair.far, known_pair.near)
    assert len(calls) == 4
