"""Recall on photographs that were held out of a training."""

import torch

from nearfar.storage.rows import Row
from nearfar.train.batches import Batches, BatchShape
from nearfar.train.losses import counterparts, template_cosines
from nearfar.train.network import CROP
from nearfar.train.training_set import TrainingSet

REGIONS = 600
"""About how many view pairs are compared."""
CELLS = 4
"""Cells drawn from each view pair."""


def validated(
    network: torch.nn.Module, validation: TrainingSet, seed: int, device: torch.device
) -> Row:
    """Return how often the nearest of all far vectors is the correct one.

    Args:
        network: called as `LandmarkNetwork` is.
        validation: nothing of it trained on.
        seed: of the regions and views.
        device: where the network is.

    Returns:
        `landmark_recall` and `template_recall` among all regions, by their landmarks' cosine and by
        that of their cells one by one, and `cell_recall` among the cells of all views; those that
        overlap too much to be told apart do not count. The same with `real_` before it for
        views of two photographs, where the set has pairs.
    """
    count = len(validation.photographs)
    if not count:
        return {}
    shape = BatchShape(CROP, count, -(-REGIONS // count))
    row = _recalls(network, validation, shape, 0.0, seed, device)
    if validation.pairs:
        shape = BatchShape(CROP, REGIONS // 4, 4)
        real = _recalls(network, validation, shape, 1.0, seed, device)
        row |= {f"real_{name}": value for name, value in real.items()}
    return row


def _recalls(
    network: torch.nn.Module,
    validation: TrainingSet,
    shape: BatchShape,
    real: float,
    seed: int,
    device: torch.device,
) -> Row:
    batch = Batches(validation, (shape,), real=real, seed=seed, first=0, steps=1)[0]
    network.eval()
    with torch.no_grad():
        halves = [network(views.float().to(device)) for views in (batch.near, batch.far)]
    (near_cells, near), (far_cells, far) = [[each.cpu() for each in half] for half in halves]
    generator = torch.Generator().manual_seed(seed)
    drawn = counterparts(near_cells, far_cells, batch.far_from_near, CELLS, generator)
    return {
        "landmark_recall": _recall(near.flatten(1) @ far.flatten(1).T, batch.same),
        "template_recall": _recall(template_cosines(near_cells, far_cells), batch.same),
        "cell_recall": _recall(drawn[0] @ drawn[1].T, drawn[2]),
    }


def _recall(cosines: torch.Tensor, ignored: torch.Tensor) -> float:
    nearest = cosines.masked_fill(ignored, -2).argmax(dim=1)
    return float((nearest == torch.arange(len(cosines))).float().mean())
