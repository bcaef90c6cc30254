import numpy as np
import pytest

torch = pytest.importorskip("torch")

from nearfar.networks.graph import INPUT  # noqa: E402
from nearfar.networks.landmark_network import CELLS, LANDMARKS, part  # noqa: E402
from nearfar.runtime.onnx import session  # noqa: E402
from nearfar.train.export import onnx_model  # noqa: E402
from nearfar.train.network import LandmarkNetwork  # noqa: E402


def test_exported_network_computes_what_torch_computes() -> None:
    torch.manual_seed(0)
    network = LandmarkNetwork(8)
    images = torch.randint(0, 256, (4, 3, 96, 128), dtype=torch.uint8)
    network.train()
    for _ in range(3):
        network(images.float())
    network.eval()
    with torch.no_grad():
        expected = dict(zip((CELLS, LANDMARKS), network(images.float()), strict=True))
    pixels = np.ascontiguousarray(images.numpy().transpose(0, 2, 3, 1))
    model = onnx_model(network)
    for output, values in expected.items():
        (found,) = session(part(model, output, None)).run(None, {INPUT: pixels})
        assert found.shape == values.shape
        np.testing.assert_allclose(found, values.numpy(), atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)
