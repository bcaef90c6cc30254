from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from nearfar.errors import TrainingError  # noqa: E402
from nearfar.train.batches import Batch, Batches, BatchShape  # noqa: E402
from nearfar.train.export import save_model  # noqa: E402
from nearfar.train.network import LandmarkNetwork  # noqa: E402
from nearfar.train.photographs import Photograph  # noqa: E402
from nearfar.train.start import network_of  # noqa: E402
from nearfar.train.training_set import TrainingSet  # noqa: E402


@pytest.fixture
def batch(photographs: list[Photograph]) -> Batch:
    shapes = (BatchShape(64, 2, 4),)
    return Batches(TrainingSet(photographs), shapes, real=0.0, seed=0, first=0, steps=1)[0]


def test_a_network_computes_the_same_when_it_is_trained_further(
    batch: Batch, tmp_path: Path
) -> None:
    torch.manual_seed(3)
    network = LandmarkNetwork(8)
    views = torch.cat([batch.near, batch.far]).float()
    for _ in range(5):
        network.train()(0.8 * views + 9)  # Running statistics that are not those of the views.
    expected = network.eval()(views)
    again = network_of(save_model(network, tmp_path), batch)
    for found in (again.eval()(views), again.train()(views)):
        for one, other in zip(found, expected, strict=True):
            torch.testing.assert_close(one, other, atol=2e-4, rtol=1e-3)


def test_another_file_is_named(batch: Batch, tmp_path: Path) -> None:
    file = tmp_path / "landmark_network.onnx"
    file.write_bytes(b"no network")
    with pytest.raises(TrainingError, match="no landmark network to start from"):
        network_of(file, batch)
