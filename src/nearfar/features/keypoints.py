"""Keypoints of one image and matches of two: what detectors and matchers take and return."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nearfar.arrays import Coordinates, Mask


@dataclass(frozen=True, eq=False)
class Keypoints:
    """The N keypoints of one image; row i of each array describes keypoint i.

    Attributes:
        xy: (N, 2) float64, positions in pixels; (0, 0) is the centre of the top left pixel.
        scale: (N,) float64, diameter of the described region in pixels.
        angle: (N,) float64, orientation in radians, clockwise from the x axis.
        score: (N,) float64, response of the detector, larger for a stronger keypoint; scores of
            two detectors cannot be compared, and all are 0 where they are not known.
        descriptors: (N, D) float32; bits of binary descriptors are the numbers 0 and 1, so that
            the squared Euclidean distance of two descriptors is their Hamming distance.
    """

    xy: Coordinates
    scale: NDArray[np.float64]
    angle: NDArray[np.float64]
    score: NDArray[np.float64]
    descriptors: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        xy: ArrayLike,
        descriptors: ArrayLike,
        *,
        scale: ArrayLike = 1.0,
        angle: ArrayLike = 0.0,
        score: ArrayLike = 0.0,
    ) -> "Keypoints":
        """Return keypoints with arrays of the documented types; one number counts for all rows.

        Args:
            xy: (N, 2) positions in pixels.
            descriptors: (N, D).
            scale: (N,) diameters in pixels.
            angle: (N,) orientations in radians.
            score: (N,) responses.

        Raises:
            ValueError: an array has another shape.
        """
        places = np.asarray(xy, np.float64).reshape(-1, 2)
        described = np.asarray(descriptors, np.float32)
        if described.ndim != 2 or len(described) != len(places):
            raise ValueError(
                f"descriptors of {len(places)} keypoints are an array ({len(places)}, D), not "
                f"{described.shape}"
            )
        diameter, orientation, response = (
            np.broadcast_to(np.asarray(each, np.float64), len(places)).copy()
            for each in (scale, angle, score)
        )
        return cls(places, diameter, orientation, response, described)

    @classmethod
    def concatenated(cls, parts: Sequence["Keypoints"]) -> "Keypoints":
        """Return the keypoints of all parts, in the order of the parts; there is at least one."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def __len__(self) -> int:
        return len(self.xy)

    def __getitem__(self, chosen: Mask | NDArray[np.intp] | slice) -> "Keypoints":
        return Keypoints(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @property
    def nbytes(self) -> int:
        """Memory of the arrays in bytes."""
        return sum(getattr(self, field.name).nbytes for field in fields(self))


@dataclass(frozen=True, eq=False)
class ImageMatches:
    """N point matches of two images.

    Attributes:
        far: (N, 2) float64, points of the far image in pixels.
        near: (N, 2) float64, points of the near image in pixels.
        score: (N,) float64, from 0 to 1, larger for a match that is more likely correct; 1 where
            the matcher does not tell.
    """

    far: Coordinates
    near: Coordinates
    score: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.far)

    def __getitem__(self, chosen: Mask | NDArray[np.intp] | slice) -> "ImageMatches":
        return ImageMatches(self.far[chosen], self.near[chosen], self.score[chosen])
