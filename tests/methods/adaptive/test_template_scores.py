"""Scores by convolution are those of comparing every cell, at every border and map size."""

import numpy as np
import pytest
from numpy.typing import NDArray

from nearfar.methods.adaptive.template_scores import CellTemplate, TemplateBank

SIZE = 5


def directly(cells: NDArray[np.float32], template: CellTemplate) -> NDArray[np.float64]:
    """Place the template at each cell, and compare cell by cell."""
    rows, columns, _ = cells.shape
    found = np.zeros((rows, columns))
    for vector, (down, right) in zip(template.vectors, template.offsets, strict=True):
        for row in range(max(0, -down), min(rows, rows - down)):
            for column in range(max(0, -right), min(columns, columns - right)):
                found[row, column] += vector @ cells[row + down, column + right]
    return found / max(1, len(template.vectors))


def template(rng: np.random.Generator, low: int, high: int, count: int) -> CellTemplate:
    offsets = np.unique(rng.integers(low, high, (count, 2)), axis=0)
    return CellTemplate(rng.normal(size=(len(offsets), SIZE)).astype(np.float32), offsets)


@pytest.mark.parametrize("shape", [(1, 1), (3, 70), (70, 3), (47, 46)])
def test_scores_are_those_of_every_cell(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    cells = rng.normal(size=(*shape, SIZE)).astype(np.float32)
    templates = [template(rng, -8, 9, 30), template(rng, -2, 12, 20), template(rng, 3, 4, 1)]
    scores = TemplateBank(templates, SIZE).scores(cells)
    assert scores.shape == (3, *shape)
    for score, each in zip(scores, templates, strict=True):
        np.testing.assert_allclose(score, directly(cells, each), atol=1e-5)


def test_templates_larger_than_a_tile_or_without_cells() -> None:
    rng = np.random.default_rng(1)
    cells = rng.normal(size=(20, 100, SIZE)).astype(np.float32)
    large = template(rng, -40, 41, 12)
    none = CellTemplate(np.empty((0, SIZE), np.float32), np.empty((0, 2), np.intp))
    found, empty = TemplateBank([large, none], SIZE).scores(cells)
    np.testing.assert_allclose(found, directly(cells, large), atol=1e-5)
    assert not empty.any()
