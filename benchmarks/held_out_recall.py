"""Recall of landmark networks on photographs that were held out, over several draws of regions.

    python benchmarks/held_out_recall.py PHOTOS NETWORK.onnx ... [--scenes] [--neighbours 2]

With `--scenes` nothing of PHOTOS was trained on, and all of it is compared. Otherwise it is the
folder of a training, and what that held out is compared. Needs the extra `train`.
"""

import argparse
from pathlib import Path

import onnxruntime
import torch
from torch import Tensor, nn

from nearfar.train.mining import mined_pairs
from nearfar.train.photographs import read_photographs
from nearfar.train.training import FULL
from nearfar.train.training_set import TrainingSet
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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("photographs", type=Path)
    parser.add_argument("networks", type=Path, nargs="+")
    parser.add_argument("--scenes", action="store_true", help="compare all of PHOTOS")
    parser.add_argument("--neighbours", type=int, default=2)
    given = parser.parse_args()
    photographs, _ = read_photographs([given.photographs])
    found = TrainingSet(photographs, mined_pairs(photographs, given.neighbours))
    validation = found if given.scenes else found.held_out(FULL.held_out)[1]
    for seed in range(DRAWS):
        for file in given.networks:
            row = validated(Exported(file), validation, seed, torch.device("cpu"))
            print(seed, file, {name: round(value, 3) for name, value in row.items()}, flush=True)


if __name__ == "__main__":
    main()
