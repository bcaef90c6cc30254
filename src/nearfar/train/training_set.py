"""What a descriptor is trained on: photographs, and matched points of those of one place."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from nearfar.arrays import Coordinates
from nearfar.train.photographs import Photograph


@dataclass(frozen=True, eq=False)
class RealPair:
    """Two photographs of one place, and where points of the one lie in the other.

    Attributes:
        far: index of one photograph.
        near: index of the other.
        far_points: (N, 2) pixels of the first.
        near_points: (N, 2) the same points in pixels of the second.
    """

    far: int
    near: int
    far_points: Coordinates
    near_points: Coordinates

    def swapped(self) -> "RealPair":
        """Return the pair with the roles of both photographs exchanged."""
        return RealPair(self.near, self.far, self.near_points, self.far_points)


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Photographs, some of which may show one place.

    Attributes:
        photographs: each with the index by which the pairs name it.
        pairs: photographs that show one place.
    """

    photographs: list[Photograph]
    pairs: tuple[RealPair, ...] = ()

    def places(self) -> NDArray[np.int32]:
        """Return (N,) a number for the place of each photograph: one for all that pairs connect."""
        count = len(self.photographs)
        ends = np.array([(pair.far, pair.near) for pair in self.pairs], np.intp).reshape(-1, 2)
        connected = coo_array((np.ones(len(ends)), ends.T), (count, count))
        return np.asarray(connected_components(connected, directed=False)[1])

    def chosen(self, indices: Iterable[int]) -> "TrainingSet":
        """Return a set of some photographs, in their order, and the pairs among them."""
        kept = list(indices)
        index = {old: new for new, old in enumerate(kept)}
        pairs = tuple(
            replace(pair, far=index[pair.far], near=index[pair.near])
            for pair in self.pairs
            if pair.far in index and pair.near in index
        )
        return TrainingSet([self.photographs[old] for old in kept], pairs)

    def held_out(self, every: int) -> tuple["TrainingSet", "TrainingSet"]:
        """Return a set to train on and, one place in `every`, one to validate with.

        All photographs of a place are on one side.
        """
        places = self.places()
        order = {place: number for number, place in enumerate(dict.fromkeys(places.tolist()))}
        aside = np.array([order[place] % every == every - 1 for place in places.tolist()], np.bool_)
        return self.chosen(np.flatnonzero(~aside)), self.chosen(np.flatnonzero(aside))
