"""A guess where the near image lies in the far image."""

from dataclasses import dataclass, replace

from nearfar.arrays import Matrix3


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A transform to be tried.

    Attributes:
        far_from_near: homography, near to far pixels of the working images.
        support: how much speaks for it; comparable within one source.
        source: what proposed it: "expected" (by the caller), "votes", "landmarks", "region views"
            or "views".
    """

    far_from_near: Matrix3
    support: float
    source: str

    def between(self, far_from_own: Matrix3, own_from_near: Matrix3) -> "Hypothesis":
        """The same for the images that these transforms lead to and from."""
        return replace(self, far_from_near=far_from_own @ self.far_from_near @ own_from_near)
