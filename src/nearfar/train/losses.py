"""The losses of the training: vectors of two views of one thing are to be nearest neighbours."""

import torch
from torch import Tensor
from torch.nn import functional

from nearfar.train.network import CROP, STRIDE

TEMPERATURE = 0.06
"""Of the softmax over cosines of vectors."""
TEMPLATE_TEMPERATURE = 0.04
"""Of the softmax over mean cosines of cells."""


def template_loss(near: Tensor, far: Tensor, ignored: Tensor) -> Tensor:
    """Return the cross entropy of each view's counterpart by the cosine of all their cells.

    That is how the landmark search compares: the mean cosine of cells at the same place, after the
    mean of all cells is subtracted. Cells have to be alike where the views do not quite agree in
    place, scale and direction.

    Args:
        near: (N, D, H, W) cells of near views.
        far: (N, D, H, W) cells of far views.
        ignored: (N, N) pairs that are neither counterparts nor negatives.
    """
    return _cross_entropy((template_cosines(near, far) - 1) / TEMPLATE_TEMPERATURE, ignored)


def template_cosines(near: Tensor, far: Tensor) -> Tensor:
    """Return (N, N) mean cosine of the cells of each near view with those of each far view."""
    mean = torch.cat([near, far]).mean(dim=(0, 2, 3), keepdim=True)
    flat = [functional.normalize(each - mean, dim=1).flatten(1) for each in (near, far)]
    return flat[0] @ flat[1].T / (near.shape[2] * near.shape[3])


def middle(cells: Tensor) -> Tensor:
    """Return the cells of a view; of a large one without those at its border, which see less.

    Args:
        cells: (N, D, H, W).
    """
    height, width = cells.shape[2:]
    if min(height, width) <= CROP // STRIDE:
        return cells
    return cells[:, :, height // 8 : -(height // 8), width // 8 : -(width // 8)]


def contrastive_loss(near: Tensor, far: Tensor, ignored: Tensor) -> Tensor:
    """Return cross entropy of finding each vector's counterpart among all, both ways.

    That is the loss of CLIP (Radford et al., 2021), or InfoNCE (van den Oord et al., 2018).

    Args:
        near: (N, D) of unit length.
        far: (N, D), counterparts in the same order.
        ignored: (N, N) pairs that are neither counterparts nor negatives.
    """
    least = near.new_full((), -1 / TEMPERATURE)
    return _cross_entropy(torch.addmm(least, near / TEMPERATURE, far.T), ignored)


def _cross_entropy(logits: Tensor, ignored: Tensor) -> Tensor:
    """Return the cross entropy of each row's and each column's counterpart on the diagonal.

    Args:
        logits: (N, N) of cosines, less their greatest value, so that their exponentials, most of
            the work, serve both ways; overwritten.
        ignored: (N, N) pairs that are neither counterparts nor negatives.
    """
    right = logits.diagonal().clone()
    likely = logits.masked_fill_(ignored, -torch.inf).exp()
    among = (likely.sum(dim=0).log() + likely.sum(dim=1).log()) / 2
    return (among - right).mean()


def counterparts(
    near: Tensor, far: Tensor, far_from_near: Tensor, count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Return vectors of the same places in cell maps of both views.

    Args:
        near: (N, D, H, W) cells of the near views.
        far: (N, D, H, W) cells of the far views.
        far_from_near: (N, 3, 3) maps pixels of the near views to those of the far views.
        count: cells to draw from each pair; those that lie outside the far view are left out.
        generator: draws them.

    Returns:
        (M, D) near, (M, D) far vectors interpolated between cells, and (M, M) pairs whose places in
        the same far view are less than 1.5 cells apart, which are no negatives.
    """
    pairs, _, height, width = near.shape
    drawn = torch.randint(height * width, (pairs, count), generator=generator).to(near.device)
    row, column = drawn // width, drawn % width
    index = torch.arange(pairs, device=near.device)[:, None].expand(-1, count)
    at = torch.stack([column, row, torch.ones_like(row)], dim=-1).float()
    at[..., :2] *= STRIDE
    mapped = torch.einsum("nij,nkj->nki", far_from_near, at)
    place = mapped[..., :2] / mapped[..., 2:].clamp(min=1e-6) / STRIDE
    last = torch.tensor([width - 1.0, height - 1.0], device=near.device)
    inside = ((place >= 0) & (place <= last)).all(dim=-1) & (mapped[..., 2] > 1e-6)
    sampled = functional.grid_sample(
        far, (place / last * 2 - 1)[:, :, None], align_corners=True, padding_mode="border"
    )
    here = near[index, :, row, column][inside]
    there = functional.normalize(sampled[..., 0].transpose(1, 2)[inside], dim=-1)
    close = torch.cdist(place, place) < 1.5
    close.diagonal(dim1=1, dim2=2).fill_(False)
    close &= inside[:, :, None] & inside[:, None]
    number = inside.flatten().cumsum(0).view_as(inside) - 1
    pair, one, other = close.nonzero(as_tuple=True)
    ignored = torch.zeros(len(here), len(here), dtype=torch.bool, device=near.device)
    ignored[number[pair, one], number[pair, other]] = True
    return here, there, ignored
