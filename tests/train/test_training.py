import dataclasses
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from nearfar.errors import SettingsError, TrainingError  # noqa: E402
from nearfar.storage.rows import read_rows  # noqa: E402
from nearfar.train.export import save_model  # noqa: E402
from nearfar.train.network import LandmarkNetwork  # noqa: E402
from nearfar.train.photographs import Photograph  # noqa: E402
from nearfar.train.training import (  # noqa: E402
    CHECKPOINT,
    CONFIGURATION,
    LOG,
    SMALL,
    Configuration,
    train,
)
from nearfar.train.training_set import TrainingSet  # noqa: E402

NOTHING = TrainingSet([])
FEW = dataclasses.replace(SMALL, steps=4, every=2)


class StoppedError(Exception):
    """A training is killed."""


def trained(
    photographs: list[Photograph], out: Path, configuration: Configuration = FEW
) -> dict[str, Any]:
    training, validation = halves(photographs)
    return dict(train(training, validation, configuration, out, jobs=0).state_dict())


def halves(photographs: list[Photograph]) -> tuple[TrainingSet, TrainingSet]:
    return TrainingSet(photographs[:3]), TrainingSet(photographs[3:])


@pytest.fixture(scope="module")
def finished(
    photographs: list[Photograph], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    """The folder of a training of a few steps, and its weights."""
    folder = tmp_path_factory.mktemp("training") / "finished"
    return folder, trained(photographs, folder)


@pytest.fixture
def copied(finished: tuple[Path, dict[str, Any]], tmp_path: Path) -> Path:
    """A copy of the folder of a training, which a test may change."""
    return shutil.copytree(finished[0], tmp_path / "copied")


def test_resumed_training_ends_like_one_in_a_go(
    photographs: list[Photograph], finished: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    _, whole = finished

    def stop(step: int, _row: object) -> None:
        if step == 3:
            raise StoppedError

    with pytest.raises(StoppedError):
        train(*halves(photographs), FEW, tmp_path / "parts", jobs=0, progress=stop)
    assert [row["step"] for row in read_rows(tmp_path / "parts" / LOG)] == [2]
    parts = trained(photographs, tmp_path / "parts")
    assert [row["step"] for row in read_rows(tmp_path / "parts" / LOG)] == [2, 4]
    for name, values in whole.items():
        assert torch.equal(values, parts[name]), name


def test_same_seed_same_network_another_seed_another(
    photographs: list[Photograph], finished: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    _, one = finished
    same = trained(photographs, tmp_path / "same")
    other = trained(photographs, tmp_path / "other", dataclasses.replace(FEW, seed=1))
    weight = "landmark.weight"
    assert torch.equal(one[weight], same[weight])
    assert not torch.equal(one[weight], other[weight])


def test_losses_fall(photographs: list[Photograph], tmp_path: Path) -> None:
    trained(photographs, tmp_path, dataclasses.replace(SMALL, steps=60, every=20))
    rows = read_rows(tmp_path / LOG)
    assert rows[-1]["cell_loss"] < rows[0]["cell_loss"] - 0.2
    assert rows[-1]["landmark_loss"] < rows[0]["landmark_loss"]
    assert rows[-1]["cell_recall"] > 3 / 600


def test_training_goes_on_from_a_network_where_that_one_ended(
    photographs: list[Photograph], finished: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    last = read_rows(finished[0] / LOG)[-1]
    network = LandmarkNetwork(FEW.width)
    network.load_state_dict(finished[1])
    start = save_model(network, tmp_path)
    frozen = dataclasses.replace(FEW, learning_rate=0.0, weight_decay=0.0)
    out = tmp_path / "further"
    train(*halves(photographs), frozen, out, start=start, jobs=0)
    row = read_rows(out / LOG)[-1]
    assert row["cell_loss"] == pytest.approx(last["cell_loss"], rel=0.2)
    start.write_bytes(b"no network")
    with pytest.raises(TrainingError, match="no landmark network"):
        train(*halves(photographs), frozen, tmp_path / "other", start=start, jobs=0)


def test_folder_of_another_training_is_refused(photographs: list[Photograph], copied: Path) -> None:
    before = (copied / CHECKPOINT).read_bytes()
    for configuration in (dataclasses.replace(FEW, seed=2), dataclasses.replace(FEW, steps=8)):
        with pytest.raises(TrainingError, match="another configuration"):
            trained(photographs, copied, configuration)
    with pytest.raises(TrainingError, match="other photographs"):
        train(TrainingSet(photographs[:2]), NOTHING, FEW, copied, jobs=0)
    assert (copied / CHECKPOINT).read_bytes() == before


def test_a_full_disk_keeps_the_checkpoint_before(
    photographs: list[Photograph], tmp_path: Path
) -> None:
    def fill(step: int, _row: object) -> None:
        if step == 2:
            (tmp_path / f".{CHECKPOINT}.{os.getpid()}").symlink_to("/dev/full")

    with pytest.raises(OSError, match="No space left"):
        train(*halves(photographs), FEW, tmp_path, jobs=0, progress=fill)
    assert torch.load(tmp_path / CHECKPOINT, weights_only=True)["step"] == 2


def test_a_negative_number_of_jobs_is_refused(
    photographs: list[Photograph], tmp_path: Path
) -> None:
    with pytest.raises(SettingsError, match="--jobs"):
        train(TrainingSet(photographs), NOTHING, FEW, tmp_path, jobs=-1)


def test_too_few_photographs(photographs: list[Photograph], tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="too few"):
        train(TrainingSet(photographs[:1]), NOTHING, FEW, tmp_path)


@pytest.mark.parametrize("name", ["steps", "width", "cells", "held_out", "every"])
def test_configuration_is_checked(name: str) -> None:
    with pytest.raises(SettingsError):
        Configuration(**{name: 0})  # type: ignore[arg-type]


def test_damaged_folders_are_named(photographs: list[Photograph], copied: Path) -> None:
    (copied / CHECKPOINT).write_bytes(bytes(range(256)) * 4)
    with pytest.raises(TrainingError, match=CHECKPOINT):
        trained(photographs, copied)
    (copied / CONFIGURATION).write_bytes(bytes(range(256)))
    with pytest.raises(TrainingError, match="another configuration"):
        trained(photographs, copied)


def test_without_validation_photographs_there_is_no_recall(
    photographs: list[Photograph], tmp_path: Path
) -> None:
    train(TrainingSet(photographs), NOTHING, FEW, tmp_path, jobs=0)
    row = read_rows(tmp_path / LOG)[-1]
    assert "cell_recall" not in row
    assert np.isfinite(row["cell_loss"])
