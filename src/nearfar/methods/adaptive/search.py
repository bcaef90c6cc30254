"""Landmark search: the near image as a template of features, sought in a pyramid of the far image.

Proposals do not repeat across a large change of scale, so the landmark is not matched to the far
image's landmarks but searched for, at every place, scale and rotation.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.constants import DEFAULT, SearchConstants
from nearfar.descriptors import DenseDescriptor
from nearfar.features.feature_map import FeatureMap
from nearfar.geometry.homography import transform, translation
from nearfar.imaging.mask import MaskedImage, usable
from nearfar.imaging.warp import resized
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.simulated_views import FRONTAL, simulate
from nearfar.methods.adaptive.template_scores import CellTemplate, TemplateBank
from nearfar.runtime.threads import in_order

BAND_PIXELS = 3_300_000
"""Pixels of a band in which a level is described, which bounds the network's memory."""
BAND_MARGIN = 64
"""Rows around a band that its features see, in pixels."""


@dataclass(frozen=True, eq=False)
class Level:
    """One level of the far image's pyramid.

    Attributes:
        level_from_image: scales the image to the level.
        vectors: (rows, columns, D) of unit length, in the basis of the pyramid.
        stride: distance of neighbouring cells in pixels of the level.
    """

    level_from_image: Matrix3
    vectors: NDArray[np.float32]
    stride: int


@dataclass(frozen=True, eq=False)
class Pyramid:
    """The features of the far image at many scales, in the principal components of one of them.

    Attributes:
        levels: the largest first.
        mean: (C,) mean feature, which is subtracted from those of templates.
        basis: (C, D) principal components.
    """

    levels: list[Level]
    mean: NDArray[np.float32]
    basis: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """Return memory that the levels take, in bytes."""
        return sum(level.vectors.nbytes for level in self.levels)


@dataclass(frozen=True, eq=False)
class Template:
    """The features of the near image in one rotation.

    Attributes:
        vectors: (K, D) of its cells inside the image.
        cells: (K, 2) row and column of each.
        shape: rows and columns of the whole template.
        template_from_near: near pixels to pixels of the template.
    """

    vectors: NDArray[np.float32]
    cells: NDArray[np.intp]
    shape: tuple[int, int]
    template_from_near: Matrix3


def pyramid(
    image: MaskedImage, descriptor: DenseDescriptor, constants: SearchConstants = DEFAULT.search
) -> Pyramid:
    """Return the feature maps of an image at many scales; none for an image of a few pixels."""
    width, height = image.size
    scales = _scales(height, width, constants)
    middle = scales[len(scales) // 2]
    mean, basis = _principal_components(image.pixels, middle, descriptor, constants)
    used = scales if basis.size else []
    levels = [_level(image, scale, descriptor, basis) for scale in used]
    return Pyramid(levels, mean, basis)


def upsampled(
    base: Pyramid,
    image: MaskedImage,
    descriptor: DenseDescriptor,
    constants: SearchConstants = DEFAULT.search,
) -> Pyramid:
    """Return the upsampled levels of an image's pyramid; each costs more than that whole one."""
    if not base.levels:
        return base
    width, height = image.size
    first = _scales(height, width, constants)[0]
    most = math.sqrt(constants.most_enlarged_pixels / (height * width))
    largest = min(constants.largest_enlarged, most)
    ratio = _level_ratio(constants.enlarged_per_octave)
    count = max(0, round(math.log(largest / first, ratio)))
    levels = [_level(image, largest / ratio**step, descriptor, base.basis) for step in range(count)]
    return replace(base, levels=levels)


def _level(
    image: MaskedImage, scale: float, descriptor: DenseDescriptor, basis: NDArray[np.float32]
) -> Level:
    matrix, features = _features(image.pixels, scale, descriptor)
    own = features.values
    vectors = unit((own - own.mean(axis=(0, 1))) @ basis)
    if image.mask is not None:
        cells = transform(np.linalg.inv(matrix), features.centres)
        vectors[~usable(image.mask, image.size, cells).reshape(own.shape[:2])] = 0
    return Level(matrix, vectors, features.stride)


def _principal_components(
    pixels: RGBPixels, scale: float, descriptor: DenseDescriptor, constants: SearchConstants
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return mean and leading principal components of the features at one scale."""
    values = _features(pixels, scale, descriptor)[1].values
    flat = values.reshape(-1, values.shape[-1])
    mean = flat.mean(axis=0)
    _, _, components = np.linalg.svd(
        flat[:: max(1, len(flat) // constants.most_cells)] - mean, full_matrices=False
    )
    return mean, np.ascontiguousarray(components[: constants.dimensions].T)


def _scales(height: int, width: int, constants: SearchConstants) -> list[float]:
    """Return the scales of the levels, the largest first: at least one."""
    most = math.sqrt(constants.most_pixels / (height * width))
    largest = min(constants.largest_scale, most)
    least = max(constants.smallest_scale, constants.template_side / 2 / max(height, width))
    ratio = _level_ratio(constants.levels_per_octave)
    count = max(1, 1 + math.floor(math.log(largest / least, ratio)))
    return [largest / ratio**index for index in range(count)]


def _level_ratio(per_octave: int) -> float:
    return float(2 ** (1 / per_octave))


def _features(
    pixels: RGBPixels, scale: float, descriptor: DenseDescriptor
) -> tuple[Matrix3, FeatureMap]:
    seen, matrix = resized(pixels, scale)
    height, width = seen.shape[:2]
    rows = max(BAND_MARGIN, BAND_PIXELS // width // BAND_MARGIN * BAND_MARGIN)
    starts = range(0, height, rows)
    bands = list(in_order(lambda start: _band(seen, start, rows, descriptor), starts))
    return matrix, replace(bands[0], values=np.concatenate([each.values for each in bands]))


def _band(pixels: RGBPixels, start: int, rows: int, descriptor: DenseDescriptor) -> FeatureMap:
    """Describe some rows of pixels with the rows around them that their features see."""
    above = min(start, BAND_MARGIN)
    features = descriptor.feature_map(pixels[start - above : start + rows + BAND_MARGIN])
    first = above // features.stride
    end = first + rows // features.stride if start + rows < len(pixels) else None
    return replace(features, values=features.values[first:end])


def templates(
    image: MaskedImage, descriptor: DenseDescriptor, constants: SearchConstants = DEFAULT.search
) -> list[Template]:
    """Return the reduced image as a template, in every rotation."""
    reduced, matrix = resized(image.pixels, constants.template_side / max(image.size))
    turns = constants.turns
    angles = [360 / turns * turn for turn in range(turns)]
    return list(
        in_order(lambda angle: _template(image, reduced, matrix, angle, descriptor), angles)
    )


def search(
    far: Pyramid,
    sought: list[Template],
    near_size: tuple[int, int],
    most: int,
    constants: SearchConstants = DEFAULT.search,
) -> list[Hypothesis]:
    """Return the best places, scales and rotations of the near image, best first.

    Args:
        far: of the far image.
        sought: of the near image.
        near_size: its width and height.
        most: how many.
        constants: of the search.
    """
    if not far.levels or not sought:
        return []
    bank = TemplateBank([_projected(each, far) for each in sought], far.basis.shape[1])
    peaks = list(in_order(lambda level: _peaks(level, bank, sought, most), far.levels))
    score, matrices = (np.concatenate(each) for each in zip(*peaks, strict=True))
    order = np.argsort(-score, kind="stable")
    score, matrices = score[order], matrices[order]
    return [
        Hypothesis(matrices[index], float(score[index]), "landmarks")
        for index in _distinct(matrices, near_size, most, constants)
    ]


def distinct(
    sorted_hypotheses: Sequence[Hypothesis],
    near_size: tuple[int, int],
    most: int,
    constants: SearchConstants = DEFAULT.search,
) -> list[Hypothesis]:
    """Return the first hypotheses that are at another place, scale or rotation than those before.

    Args:
        sorted_hypotheses: affine transforms, best first.
        near_size: width and height of the near image.
        most: how many.
        constants: of the search.
    """
    if not sorted_hypotheses:
        return []
    matrices = np.array([each.far_from_near for each in sorted_hypotheses])
    return [sorted_hypotheses[each] for each in _distinct(matrices, near_size, most, constants)]


def _distinct(
    matrices: NDArray[np.float64],
    near_size: tuple[int, int],
    most: int,
    constants: SearchConstants,
) -> list[int]:
    """Return the indices of (N, 3, 3) transforms that differ from all that are kept before."""
    width, height = near_size
    centres = matrices[:, :2] @ [(width - 1) / 2, (height - 1) / 2, 1.0]
    determinants = np.linalg.det(matrices[:, :2, :2])
    scales = np.sqrt(np.maximum(np.abs(determinants), 1e-300))
    angles = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
    radii = constants.peak_distance * math.hypot(width, height) * scales
    left = np.arange(len(matrices))
    kept: list[int] = []
    while len(left) and len(kept) < most:
        first, left = int(left[0]), left[1:]
        kept.append(first)
        same = np.linalg.norm(centres[left] - centres[first], axis=1) < radii[first]
        same &= np.abs(np.log(scales[left] / scales[first])) < math.log(constants.peak_scale)
        turned = np.cos(angles[left] - angles[first])
        same &= turned > math.cos(math.radians(constants.peak_angle))
        left = left[~same]
    return kept


def _template(
    image: MaskedImage,
    pixels: RGBPixels,
    template_from_near: Matrix3,
    angle: float,
    descriptor: DenseDescriptor,
) -> Template:
    seen, matrix = simulate(pixels, FRONTAL, angle)
    (top, bottom), (left, right) = map(_border, seen.shape[:2])
    padded = cv2.copyMakeBorder(seen, top, bottom, left, right, cv2.BORDER_REFLECT_101)
    matrix = translation(left, top) @ matrix
    features = descriptor.feature_map(np.asarray(padded))
    rows, columns = features.values.shape[:2]
    own = transform(np.linalg.inv(matrix), features.centres)
    height, width = pixels.shape[:2]
    covered = ((own >= -0.5) & (own <= [width - 0.5, height - 0.5])).all(axis=1)
    if image.mask is not None:
        covered &= usable(image.mask, image.size, transform(np.linalg.inv(template_from_near), own))
    return Template(
        features.values.reshape(rows * columns, -1)[covered],
        np.argwhere(covered.reshape(rows, columns)),
        (rows, columns),
        matrix @ template_from_near,
    )


def _border(length: int) -> tuple[int, int]:
    """Return the pixels to add at both ends so that cells cover the image."""
    missing = 8 * math.ceil(length / 8) + 8 - length
    return missing // 2, missing - missing // 2


def _projected(template: Template, far: Pyramid) -> CellTemplate:
    """Return a template in the basis of a pyramid, placed by its middle."""
    vectors = unit((template.vectors - far.mean) @ far.basis)
    return CellTemplate(vectors, template.cells - np.array(template.shape) // 2)


def _peaks(
    level: Level, bank: TemplateBank, sought: list[Template], most: int
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the (N,) scores of the best peaks of each template and (N, 3, 3) transforms."""
    image_from_level = np.linalg.inv(level.level_from_image)
    scores, matrices = [], []
    for template, score in zip(sought, bank.scores(level.vectors), strict=True):
        highest = cv2.dilate(score, np.ones((5, 5), np.uint8))
        y, x = np.nonzero(score == highest)
        best = np.argsort(-score[y, x], kind="stable")[:most]
        corners = np.column_stack([x[best], y[best]]) - np.array(template.shape[::-1]) // 2
        moved = np.tile(np.eye(3), (len(best), 1, 1))
        moved[:, :2, 2] = level.stride * corners
        scores.append(score[y[best], x[best]])
        matrices.append(image_from_level @ moved @ template.template_from_near)
    return np.concatenate(scores), np.concatenate(matrices)


def unit(vectors: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Scale the vectors of the last axis to unit length; nearly zero ones stay short."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-6), np.float32)
