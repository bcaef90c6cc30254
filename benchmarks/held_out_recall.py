"""Recall of landmark networks on the held-out photographs, over several draws of regions.

Run with `python benchmarks/held_out_recall.py PHOTOS NETWORK.onnx ...`. Needs the extra `train`.
"""

import argparse
from pathlib import Path

import onnxruntime
import torch
from torch import Tensor, nn

from nearfar.train.photographs import held_out, read_photographs
from nearfar.train.training import FULL
from nearfar.train.validation import validated

DRAWS = 4


class Exported(nn.Module):
    """A network in a file, called as `LandmarkNetwork` is."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """See `LandmarkNetwork.forward`."""
        crops = images.byte().permute(0, 2, 3, 1).contiguous().numpy()
        cells, landmarks = self._session.run(["cells", "landmarks"], {"crops": crops})
        return torch.from_numpy(cells), torch.from_numpy(landmarks)


def main() -> None:
    """Print one line for each draw and network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photographs", type=Path)
    parser.add_argument("networks", type=Path, nargs="+")
    given = parser.parse_args()
    _, validation = held_out(read_photographs([given.photographs])[0], FULL.held_out)
    for seed in range(DRAWS):
        for file in given.networks:
            row = validated(Exported(file), validation, seed, torch.device("cpu"))
            print(seed, file, {name: round(value, 3) for name, value in row.items()}, flush=True)


if __name__ == "__main__":
    main()
