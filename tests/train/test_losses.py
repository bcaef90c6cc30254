import math
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from torch.nn import functional  # noqa: E402

from nearfar.train.losses import (  # noqa: E402
    TEMPERATURE,
    contrastive_loss,
    counterparts,
    middle,
    template_cosines,
    template_loss,
)
from nearfar.train.network import STRIDE  # noqa: E402


def units(*shape: int) -> Any:
    return functional.normalize(
        torch.randn(*shape, generator=torch.Generator().manual_seed(1)), dim=1
    )


def test_loss_is_that_of_chance_for_equal_vectors_and_none_for_orthogonal_ones() -> None:
    nothing = torch.zeros(8, 8, dtype=torch.bool)
    equal = torch.ones(8, 4) / 2
    assert math.isclose(contrastive_loss(equal, equal, nothing).item(), math.log(8), rel_tol=1e-5)
    assert contrastive_loss(torch.eye(8), torch.eye(8), nothing).item() < 1e-4


def test_ignored_pairs_do_not_count() -> None:
    equal = torch.ones(8, 4) / 2
    others = ~torch.eye(8, dtype=torch.bool)
    assert contrastive_loss(equal, equal, others).item() < 1e-6


@pytest.mark.parametrize(("right", "down"), [(0, 0), (2, 1), (-3, 2)])
def test_counterparts_lie_where_the_transform_says(right: int, down: int) -> None:
    near = units(3, 16, 8, 8)
    far = torch.roll(near, (down, right), dims=(2, 3))
    matrix = torch.eye(3).repeat(3, 1, 1)
    matrix[:, 0, 2], matrix[:, 1, 2] = right * STRIDE, down * STRIDE
    here, there, close = counterparts(near, far, matrix, 20, torch.Generator().manual_seed(2))
    assert 0 < len(here) <= 60
    torch.testing.assert_close(here, there, rtol=0, atol=1e-4)
    assert not close.diagonal().any()
    if right or down:
        assert len(here) < 60


def test_places_behind_the_camera_are_left_out() -> None:
    near = units(1, 16, 8, 8)
    matrix = torch.diag(torch.tensor([1.0, 1.0, -1.0]))[None]
    here, there, _ = counterparts(near, near, matrix, 20, torch.Generator().manual_seed(2))
    assert len(here) == len(there) == 0


def test_templates_are_compared_cell_by_cell() -> None:
    cells = units(5, 16, 4, 4)
    nothing = torch.zeros(5, 5, dtype=torch.bool)
    cosines = template_cosines(cells, cells)
    torch.testing.assert_close(cosines.diagonal(), torch.ones(5))
    others = cosines[~torch.eye(5, dtype=torch.bool)]
    assert others.max() < 0.5
    moved = template_cosines(cells, torch.roll(cells, 1, dims=3))
    assert moved.diagonal().max() < 0.5
    assert template_loss(cells, cells, nothing) < template_loss(cells, cells.flip(3), nothing)


def test_middle_leaves_out_the_border_of_large_views() -> None:
    assert middle(torch.zeros(1, 2, 8, 8)).shape == (1, 2, 8, 8)
    assert middle(torch.zeros(1, 2, 16, 16)).shape == (1, 2, 12, 12)


def test_loss_is_the_mean_cross_entropy_both_ways() -> None:
    near, far = units(30, 16), units(31, 16)[1:]
    ignored = torch.rand(30, 30, generator=torch.Generator().manual_seed(3)) < 0.2
    ignored.fill_diagonal_(False)
    logits = (near @ far.T / TEMPERATURE).masked_fill(ignored, -torch.inf)
    both = [functional.cross_entropy(each, torch.arange(30)) for each in (logits, logits.T)]
    torch.testing.assert_close(contrastive_loss(near, far, ignored), sum(both) / 2)


def test_cells_of_one_view_that_lie_close_are_no_negatives() -> None:
    near = units(2, 16, 8, 8)
    matrix = torch.eye(3).repeat(2, 1, 1)
    matrix[:, :2] *= 0.2
    here, _, ignored = counterparts(near, near, matrix, 20, torch.Generator().manual_seed(2))
    assert len(here) == 40
    assert torch.equal(ignored, ignored.T)
    assert ignored.sum() > 40
    assert not ignored[:20, 20:].any()
    assert not ignored.diagonal().any()
