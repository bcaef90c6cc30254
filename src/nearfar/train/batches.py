"""Batches of view pairs, the same for the same seed and step."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from nearfar.arrays import RGBPixels
from nearfar.train.appearance import taken
from nearfar.train.photographs import Photograph
from nearfar.train.views import Region, neighbour, overlaps, random_region, view_pair

FALSE_NEGATIVE = 0.3
"""Overlap (intersection over union) from which two regions are not negatives of each other."""


@dataclass(frozen=True)
class BatchShape:
    """The number and the size of the views in a batch.

    Attributes:
        side: of the views in pixels, a multiple of 16 and at least 64.
        photographs: from which regions are drawn.
        regions: of each; every second is a neighbour of the one before it.
    """

    side: int
    photographs: int
    regions: int


@dataclass(frozen=True, eq=False)
class Batch:
    """View pairs of several regions; N is photographs times regions.

    Attributes:
        near: (N, 3, side, side) values 0 to 255.
        far: the same.
        far_from_near: (N, 3, 3) maps pixels of near views to those of far views.
        same: (N, N) whether two different regions overlap too much to be told apart.
    """

    near: Tensor
    far: Tensor
    far_from_near: Tensor
    same: Tensor


class Batches(Dataset[Batch]):
    """The batches of a training, by step.

    Args:
        photographs: to draw from.
        shapes: of the batches, in turns.
        seed: of all that is drawn.
        first: step of the first batch.
        steps: number of steps in all.
    """

    def __init__(
        self,
        photographs: list[Photograph],
        shapes: tuple[BatchShape, ...],
        *,
        seed: int,
        first: int,
        steps: int,
    ) -> None:
        self._photographs = photographs
        self._shapes = shapes
        self._seed = seed
        self._first, self._steps = first, steps

    def __len__(self) -> int:
        """Return the number of batches that are left."""
        return max(0, self._steps - self._first)

    def __getitem__(self, index: int) -> Batch:
        """Return the batch of step `first + index`."""
        step = self._first + index
        shape = self._shapes[step % len(self._shapes)]
        rng = np.random.default_rng((self._seed, step))
        regions = self._regions(shape, rng)
        pairs = [view_pair(self._photographs[r.photograph], r, shape.side, rng) for r in regions]
        same = torch.from_numpy(overlaps(regions) > FALSE_NEGATIVE).fill_diagonal_(False)
        return Batch(
            _images([taken(pair.near, shape.side, rng) for pair in pairs]),
            _images([taken(pair.far, shape.side, rng) for pair in pairs]),
            torch.tensor(np.stack([pair.far_from_near for pair in pairs]), dtype=torch.float32),
            same,
        )

    def _regions(self, shape: BatchShape, rng: np.random.Generator) -> list[Region]:
        count = len(self._photographs)
        chosen = rng.choice(count, shape.photographs, replace=count < shape.photographs)
        regions: list[Region] = []
        for index in map(int, chosen):
            photograph = self._photographs[index]
            for number in range(shape.regions):
                if number % 2:
                    regions.append(neighbour(regions[-1], photograph.size, rng))
                else:
                    regions.append(random_region(photograph, index, rng))
        return regions


def _images(views: list[RGBPixels]) -> Tensor:
    return torch.from_numpy(np.stack(views).transpose(0, 3, 1, 2).copy())
