"""How far a homography may be off, by the errors of its inliers and by what bends them.

The inliers of a homography leave errors of two kinds. Noise differs from match to match, and many
matches average it out. Misfit varies smoothly over the image: a bent lens, or depth in the scene.
Matches do not average it out, and it grows beyond them.

Both are estimated together, in a Bayesian linear regression. A residual is the sum of a change of
the homography (8 fields of displacements, of any size), of a smooth misfit (polynomials of second
and third degree, whose size is estimated), and of noise, whose size is estimated too. The result is
what the residuals say about the displacement at any place, with its variance. The variance grows
where there are no inliers.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Coordinates, Matrix3
from nearfar.constants import UncertaintyConstants
from nearfar.geometry.homography import outline, transform

CHANGES, MISFITS = 8, 15
"""Number of fields that change the homography, and of those that bend it."""
RADIAL = 3.0
"""How much larger a radial misfit may be than any other: lenses are the usual cause."""
STEP = 1e-3
"""Share of the radial misfit by which its effect in the far image is measured."""
ROUNDS = 4
"""Rounds in which the noise and what explains the residuals are estimated in turn."""
LENGTH = float(np.sqrt(np.pi)) / 2
"""Mean length of a normally distributed displacement over its root mean square."""
VAGUE = 1e3
"""Standard deviation of a change of the homography, in half diagonals of the footprint: any."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Frame:
    """Coordinates from about -1 to 1 in the footprint and in the near image.

    Attributes:
        far_from_near: the homography.
        far_centre: (2,) where it puts the centre of the near image.
        radius: root mean square distance of the footprint's corners from it, in far pixels.
        near_centre: (2,) centre of the near image.
        near_radius: half the diagonal of the near image, in near pixels.
    """

    far_from_near: Matrix3
    far_centre: Array
    radius: float
    near_centre: Array
    near_radius: float

    @staticmethod
    def of(far_from_near: Matrix3, near_size: tuple[int, int]) -> "_Frame":
        near_centre = (np.array(near_size) - 1) / 2
        far_centre = transform(far_from_near, near_centre[np.newaxis])[0]
        away = transform(far_from_near, outline(*near_size)) - far_centre
        radius = float(np.sqrt((away**2).sum(axis=1).mean()))
        return _Frame(
            far_from_near, far_centre, radius, near_centre, float(np.hypot(*near_size)) / 2
        )

    def fields(self, near: Coordinates) -> Array:
        """Return (N, 2, 23) displacements of the far point by each field, at (N, 2) near points."""
        seen = (transform(self.far_from_near, near) - self.far_centre) / self.radius
        x, y = seen.T
        a, b = ((near - self.near_centre) / self.near_radius).T
        found = np.zeros((len(near), 2, CHANGES + MISFITS))
        found[:, 0, 0] = found[:, 1, 1] = 1
        found[:, 0, 2], found[:, 0, 3] = x, y
        found[:, 1, 4], found[:, 1, 5] = x, y
        found[:, :, 6], found[:, :, 7] = x[:, np.newaxis] * seen, y[:, np.newaxis] * seen
        bends = np.column_stack([a * a, a * b, b * b, a**3, a * a * b, a * b * b, b**3])
        found[:, 0, CHANGES:-1:2] = found[:, 1, CHANGES + 1 : -1 : 2] = bends
        bent = near + STEP * (near - self.near_centre) * (a * a + b * b)[:, np.newaxis]
        moved = (transform(self.far_from_near, bent) - self.far_centre) / self.radius
        found[:, :, -1] = (moved - seen) / STEP
        return found


def homography_errors(
    far_from_near: Matrix3,
    far: Coordinates,
    near: Coordinates,
    near_size: tuple[int, int],
    at: Coordinates,
    pixel: float,
    constants: UncertaintyConstants,
) -> Array:
    """Return how far a homography is expected to be off at places of the near image.

    Args:
        far_from_near: (3, 3) homography whose footprint is finite.
        far: (N, 2) far points of the inliers, at least one.
        near: (N, 2) their near points.
        near_size: width and height of the near image in pixels.
        at: (K, 2) places of the near image.
        pixel: far pixels that a pixel of the far working image is large.
        constants: of the expected error.

    Returns:
        (K,) expected distances from the true place, in far pixels.
    """
    frame = _Frame.of(far_from_near, near_size)
    weight = match_weights(far, constants.cell * pixel)
    if len(far) > constants.most_points:
        chosen = np.linspace(0, len(far) - 1, constants.most_points).astype(np.intp)
        far, near, weight = far[chosen], near[chosen], weight[chosen]
    residuals = far - transform(far_from_near, near)
    odds, means, covariances = _regression(
        frame.fields(near), residuals, weight, frame.radius, pixel, constants
    )
    fields = frame.fields(at)
    offset = np.einsum("kij,tj->tki", fields, means)
    spread = np.matmul(fields.reshape(1, -1, CHANGES + MISFITS), covariances)
    variance = (spread * fields.reshape(1, -1, CHANGES + MISFITS)).sum(axis=2)
    squared = (offset**2).sum(axis=2) + variance.reshape(len(means), -1, 2).sum(axis=2)
    # The mean of logarithms: a misfit that is large but improbable must not decide.
    usual = 0.5 * odds @ np.log(squared + (constants.least * pixel) ** 2)
    return np.asarray(LENGTH * np.exp(usual), np.float64)


def match_weights(far: Coordinates, cell: float) -> Array:
    """Return (N,) weights by which the matches of one cell of the far image count once."""
    cells = np.floor(far / cell).astype(np.int64)
    _, index, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(1 / count[index.ravel()], np.float64)


def _regression(
    fields: Array,
    residuals: Array,
    weight: Array,
    radius: float,
    pixel: float,
    constants: UncertaintyConstants,
) -> tuple[Array, Array, Array]:
    """Explain residuals by fields of displacements and noise, for each size of the misfit.

    Args:
        fields: (N, 2, 23) displacements by each field.
        residuals: (N, 2) in far pixels.
        weight: (N,) how much each match counts.
        radius: half the diagonal of the footprint in far pixels.
        pixel: far pixels that a pixel of the far working image is large.
        constants: of the expected error.

    Returns:
        (T,) probabilities of the sizes, (T, 23) mean coefficients and (T, 22, 23) covariances.
    """
    rows = fields.reshape(-1, CHANGES + MISFITS)
    by_row = np.repeat(weight, 2)
    left = rows.T * by_row
    normal, right = left @ rows, left @ residuals.ravel()
    total, count = float((weight * (residuals**2).sum(axis=1)).sum()), float(by_row.sum())
    sizes = radius * np.array(constants.misfits)
    precision = np.empty((len(sizes), CHANGES + MISFITS))
    precision[:, :CHANGES] = (VAGUE * radius) ** -2.0
    precision[:, CHANGES:] = sizes[:, np.newaxis] ** -2.0
    precision[:, -1] = (RADIAL * sizes) ** -2.0
    diagonal = precision[:, :, np.newaxis] * np.eye(CHANGES + MISFITS)
    usual, weighs = (constants.noise * pixel) ** 2, constants.noise_weight
    noise = np.full(len(sizes), (total + weighs * usual) / (count + weighs))
    for turn in range(ROUNDS + 1):
        inverse = normal / noise[:, np.newaxis, np.newaxis] + diagonal
        covariance = np.linalg.inv(inverse)
        means = covariance @ right / noise[:, np.newaxis]
        if turn < ROUNDS:
            left_over = total - 2 * means @ right + ((means @ normal) * means).sum(axis=1)
            explained = (normal * covariance).sum(axis=(1, 2)) / noise
            freedom = np.maximum(count - explained, 0) + weighs
            noise = (np.maximum(left_over, 0) + weighs * usual) / freedom
    evidence = (
        np.log(constants.misfit_odds)
        - (count / 2 + weighs / 2 + 1) * np.log(noise)
        - (total + weighs * usual) / (2 * noise)
        + (means @ right) / (2 * noise)
        - np.linalg.slogdet(inverse)[1] / 2
        + np.log(precision).sum(axis=1) / 2
    )
    odds = np.exp(evidence - evidence.max())
    return odds / odds.sum(), means, covariance
