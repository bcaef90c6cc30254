import numpy as np
import pytest

torch = pytest.importorskip("torch")

from nearfar.train.batches import Batches, BatchShape  # noqa: E402
from nearfar.train.photographs import Photograph  # noqa: E402
from nearfar.train.training_set import RealPair, TrainingSet  # noqa: E402

SHAPES = (BatchShape(64, 2, 4), BatchShape(96, 6, 2))


def batches(photographs: list[Photograph], *, seed: int = 3, first: int = 0) -> Batches:
    return Batches(TrainingSet(photographs), SHAPES, real=0.5, seed=seed, first=first, steps=6)


def test_shapes_take_turns(photographs: list[Photograph]) -> None:
    every = batches(photographs)
    assert len(every) == 6
    assert every[0].near.shape == every[2].far.shape == (8, 3, 64, 64)
    assert every[1].near.shape == (12, 3, 96, 96)
    assert every[1].same.shape == (12, 12)


def test_a_batch_depends_on_seed_and_step_alone(photographs: list[Photograph]) -> None:
    third = batches(photographs)[2]
    resumed = batches(photographs, first=2)
    assert len(resumed) == 4
    assert torch.equal(third.far, resumed[0].far)
    assert torch.equal(third.far_from_near, resumed[0].far_from_near)
    assert not torch.equal(third.far, batches(photographs, seed=4)[2].far)
    assert not torch.equal(third.far, batches(photographs)[4].far)


def test_regions_that_overlap_are_no_negatives(photographs: list[Photograph]) -> None:
    every = batches(photographs)
    same = torch.stack([every[step].same for step in (0, 2, 4)])
    assert torch.equal(same, same.transpose(1, 2))
    assert not same.diagonal(dim1=1, dim2=2).any()
    assert not same[:, :4, 4:].any()


def test_other_photographs_of_a_place_are_no_negatives(photographs: list[Photograph]) -> None:
    x, y = np.meshgrid(np.arange(20, 440, 12.0), np.arange(20, 290, 12.0))
    points = np.column_stack([x.ravel(), y.ravel()])
    pair = RealPair(0, 2, points, points)
    of_one_place = TrainingSet(photographs, (pair,))
    batch = Batches(of_one_place, (BatchShape(64, 4, 4),), real=0.5, seed=3, first=0, steps=1)[0]
    alone = Batches(of_one_place, (BatchShape(64, 4, 4),), real=0.0, seed=3, first=0, steps=1)[0]
    assert batch.near.shape == (16, 3, 64, 64)
    assert batch.same.sum() > alone.same.sum()
    assert not torch.equal(batch.far, alone.far)
