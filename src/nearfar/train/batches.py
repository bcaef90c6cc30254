"""Batches of view pairs, the same for the same seed and step."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from nearfar.arrays import RGBPixels
from nearfar.train.appearance import taken
from nearfar.train.real_views import RealRegion, follow, real_region
from nearfar.train.training_set import RealPair, TrainingSet
from nearfar.train.views import Region, ViewPair, neighbour, overlaps, random_region, view_pair

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
        same: (N, N) whether two different regions overlap too much to be told apart, or lie in
            different photographs of one place, where nobody knows.
    """

    near: Tensor
    far: Tensor
    far_from_near: Tensor
    same: Tensor


class Batches(Dataset[Batch]):
    """The batches of a training, by step.

    Args:
        training_set: to draw from.
        shapes: of the batches, in turns.
        real: share of the photographs in a batch whose far views come from another photograph of
            the same place, as far as the set has such pairs.
        seed: of all that is drawn.
        first: step of the first batch.
        steps: number of steps in all.
    """

    def __init__(
        self,
        training_set: TrainingSet,
        shapes: tuple[BatchShape, ...],
        *,
        real: float,
        seed: int,
        first: int,
        steps: int,
    ) -> None:
        self._photographs, self._pairs = training_set.photographs, training_set.pairs
        self._places = training_set.places()
        self._shapes = shapes
        self._real = real
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
        drawn = self._drawn(shape, rng)
        pairs = [self._views(each, shape.side, rng) for each in drawn]
        regions = [each.near if isinstance(each, RealRegion) else each for each in drawn]
        photograph = np.array([region.photograph for region in regions])
        place = self._places[photograph]
        unknown = (place[:, np.newaxis] == place) & (photograph[:, np.newaxis] != photograph)
        same = torch.from_numpy((overlaps(regions) > FALSE_NEGATIVE) | unknown)
        return Batch(
            _images([taken(pair.near, shape.side, rng) for pair in pairs]),
            _images([taken(pair.far, shape.side, rng) for pair in pairs]),
            torch.tensor(np.stack([pair.far_from_near for pair in pairs]), dtype=torch.float32),
            same.fill_diagonal_(False),
        )

    def _drawn(self, shape: BatchShape, rng: np.random.Generator) -> list[Region | RealRegion]:
        real = round(self._real * shape.photographs) if self._pairs else 0
        drawn: list[Region | RealRegion] = []
        for number in map(int, rng.choice(len(self._pairs), real) if real else ()):
            pair = self._pairs[number]
            drawn += self._of_both(pair if rng.random() < 0.5 else pair.swapped(), shape, rng)
        count, made = len(self._photographs), shape.photographs - real
        for index in map(int, rng.choice(count, made, replace=count < made)):
            drawn += self._of_one(index, shape, rng)
        return drawn

    def _of_one(self, index: int, shape: BatchShape, rng: np.random.Generator) -> list[Region]:
        photograph = self._photographs[index]
        regions: list[Region] = []
        for number in range(shape.regions):
            if number % 2:
                regions.append(neighbour(regions[-1], photograph.size, rng))
            else:
                regions.append(random_region(photograph, index, rng))
        return regions

    def _of_both(
        self, pair: RealPair, shape: BatchShape, rng: np.random.Generator
    ) -> list[Region | RealRegion]:
        """Draw regions that both photographs show; of the near one alone where none is found."""
        photograph = self._photographs[pair.near]
        drawn: list[Region | RealRegion] = []
        for number in range(shape.regions):
            before = drawn[-1] if number % 2 else None
            if before is None:
                found = real_region(pair, self._photographs, rng)
                drawn.append(found or random_region(photograph, pair.near, rng))
                continue
            beside = neighbour(
                before.near if isinstance(before, RealRegion) else before, photograph.size, rng
            )
            drawn.append(follow(beside, pair, self._photographs[pair.far]) or beside)
        return drawn

    def _views(self, drawn: Region | RealRegion, side: int, rng: np.random.Generator) -> ViewPair:
        if isinstance(drawn, Region):
            return view_pair(self._photographs[drawn.photograph], drawn, side, rng)
        return view_pair(
            self._photographs[drawn.near.photograph],
            drawn.near,
            side,
            rng,
            far=self._photographs[drawn.far],
            far_from_near=drawn.far_from_near,
        )


def _images(views: list[RGBPixels]) -> Tensor:
    return torch.from_numpy(np.stack(views).transpose(0, 3, 1, 2).copy())
