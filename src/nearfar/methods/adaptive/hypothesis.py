"""A hypothesis of where the near image lies in the far image."""

from dataclasses import dataclass

from nearfar.arrays import Matrix3


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A transform to be tried.

    Attributes:
        far_from_near: homography, near to far pixels of the working images.
        support: how much speaks for it; comparable within one source.
        source: what proposed it: "expected" (by the caller), "votes", "landmarks",
            "alignment" or "views".
    """

    far_from_near: Matrix3
    support: float
    source: str
