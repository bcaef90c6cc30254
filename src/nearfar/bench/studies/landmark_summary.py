"""Tables of the landmark study."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os.path import normpath

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nearfar.bench.studies.curves import (
    Estimate,
    estimate_of,
    interval_text,
    percent,
    resampled_weights,
)
from nearfar.bench.studies.landmarks import LandmarkResult
from nearfar.bench.tables import distinct, markdown

EDGES = (1, 2, 4)
"""Lower edges of the bins of scale change."""
BINS = ("1-2", "2-4", "4 and more")

Sums = NDArray[np.float64]
"""(N,) a sum over the regions of each pair."""


@dataclass(frozen=True, eq=False)
class Tally:
    """Counts of what one descriptor found by one kind of search, for each of N pairs.

    Attributes:
        descriptor: name of the descriptor.
        dimensions: values of one descriptor.
        rows: results of the pairs.
        regions: (N,) regions that were searched for.
        findable: (N,) findable regions, see `nearfar.bench.studies.landmark_search`.
        first: (N,) regions whose first answer is correct.
        ten: (N,) regions with a correct answer among the first ten.
        first_findable: (N,) findable regions whose first answer is correct.
        ten_findable: (N,) findable regions with a correct answer among the first ten.
        precision: (N,) sum of the average precision over the findable regions; for the dense
            search, sum of the reciprocal rank over all regions.
    """

    descriptor: str
    dimensions: int | None
    rows: tuple[LandmarkResult, ...]
    regions: Sums
    findable: Sums
    first: Sums
    ten: Sums
    first_findable: Sums
    ten_findable: Sums
    precision: Sums

    @property
    def bins(self) -> NDArray[np.intp]:
        """Return (N,) the index of the bin of each pair's scale change."""
        return np.array([bin_index(row.true_scale_change) for row in self.rows], np.intp)

    @property
    def scenes(self) -> NDArray[np.intp]:
        """Return (N,) the index of each pair's scene; pairs of one far image show one scene."""
        first: dict[str, str] = {}
        names = [first.setdefault(normpath(row.far), row.scene) for row in self.rows]
        return np.unique(names, return_inverse=True)[1].astype(np.intp)

    def ratio(self, part: Sums, whole: Sums, seed: int, chosen: int | None = None) -> Estimate:
        """Return the ratio of two sums over all pairs, or over a bin, with its interval."""
        if chosen is not None:
            part, whole = (np.where(self.bins == chosen, each, 0.0) for each in (part, whole))
        weights = resampled_weights(self.scenes, seed)
        drawn = _quotient(weights @ part, weights @ whole)
        drawn = drawn[~np.isnan(drawn)]
        if not len(drawn):
            return Estimate(math.nan, math.nan, math.nan)
        return estimate_of(float(_quotient(part.sum(), whole.sum())), drawn)


def bin_index(scale: float) -> int:
    """Return the bin of a scale change; a value that rounding puts below 1 is in the first bin."""
    return int(np.searchsorted(EDGES[1:], scale, side="right"))


def tallies(rows: Sequence[LandmarkResult], search: str) -> list[Tally]:
    """Count what each descriptor found, in the pairs in which all of them had regions."""
    own = [row for row in rows if row.search == search]
    found = {(row.descriptor, row.case): row for row in own if row.regions}
    descriptors = distinct(row.descriptor for row in own)
    cases = [
        case
        for case in distinct(row.case for row in own)
        if all((descriptor, case) in found for descriptor in descriptors)
    ]
    return [
        _tally(descriptor, [found[descriptor, case] for case in cases])
        for descriptor in descriptors
        if cases
    ]


def _tally(descriptor: str, rows: Sequence[LandmarkResult]) -> Tally:
    def sums(value: Callable[[LandmarkResult], float]) -> Sums:
        return np.array([value(row) for row in rows], np.float64)

    return Tally(
        descriptor=descriptor,
        dimensions=rows[0].dimensions,
        rows=tuple(rows),
        regions=sums(lambda row: row.regions),
        findable=sums(lambda row: sum(row.findable)),
        first=sums(lambda row: _within(row, 1)),
        ten=sums(lambda row: _within(row, 10)),
        first_findable=sums(lambda row: _within(row, 1, findable=True)),
        ten_findable=sums(lambda row: _within(row, 10, findable=True)),
        precision=sums(_dense_precision if rows[0].search == "dense" else _box_precision),
    )


def _within(row: LandmarkResult, most: int, *, findable: bool = False) -> int:
    """Count regions, or findable regions, with a correct answer among the first `most`."""
    return sum(
        rank is not None and rank <= most and (possible or not findable)
        for rank, possible in zip(row.first_correct, row.findable, strict=True)
    )


def _box_precision(row: LandmarkResult) -> float:
    return math.fsum(each or 0.0 for each in row.average_precision)


def _dense_precision(row: LandmarkResult) -> float:
    return math.fsum(1 / rank for rank in row.first_correct if rank is not None)


def recall_table(found: Sequence[Tally], seed: int) -> str:
    """Return, in Markdown, the recall of each descriptor over all pairs, in percent."""
    dense = found[0].rows[0].search == "dense"
    header = [
        "descriptor",
        "values",
        "seconds a far image" if dense else "crops a second",
        "pairs",
        "regions",
        "findable",
        "recall@1",
        "recall@10",
        "recall@1 of findable",
        "recall@10 of findable",
        "mean reciprocal rank" if dense else "mAP",
    ]
    lines = []
    for own in found:
        shares = [
            (own.first, own.regions),
            (own.ten, own.regions),
            (own.first_findable, own.findable),
            (own.ten_findable, own.findable),
        ]
        lines.append(
            [
                own.descriptor,
                str(own.dimensions),
                _speed(own, dense=dense),
                str(len(own.rows)),
                f"{own.regions.sum():.0f}",
                f"{100 * own.findable.sum() / own.regions.sum():.0f}",
                *(percent(own.ratio(part, whole, seed)) for part, whole in shares),
                _number(own.ratio(own.precision, own.regions if dense else own.findable, seed)),
            ]
        )
    return markdown(header, lines)


def bin_table(found: Sequence[Tally], seed: int) -> str:
    """Return, in Markdown, recall@1 / recall@10 of each descriptor by bin of scale change."""
    first = found[0]
    lines = []
    for index, name in enumerate(BINS):
        inside = first.bins == index
        if not inside.any():
            continue
        regions = first.regions[inside].sum()
        lines.append(
            [
                name,
                str(np.count_nonzero(inside)),
                str(len(np.unique(first.scenes[inside]))),
                f"{regions:.0f}",
                f"{100 * first.findable[inside].sum() / regions:.0f}",
                *(
                    f"{percent(own.ratio(own.first, own.regions, seed, index))} / "
                    f"{100 * own.ten[inside].sum() / regions:.0f}"
                    for own in found
                ),
            ]
        )
    header = ["scale change", "pairs", "scenes", "regions", "findable"]
    return markdown([*header, *(f"{own.descriptor}: @1 / @10" for own in found)], lines)


def ratio_table(found: Sequence[Tally], baseline: str, seed: int, *, misses: bool = False) -> str:
    """Return, in Markdown, recall@1 of each descriptor over that of the baseline, also by bin.

    Args:
        found: counts of all descriptors.
        baseline: name of one of the descriptors.
        seed: seed of the intervals.
        misses: compare the numbers of findable regions whose first answer is incorrect instead.
    """
    reference = next(own for own in found if own.descriptor == baseline)

    def counted(own: Tally) -> Sums:
        return own.findable - own.first_findable if misses else own.first

    there = [index for index in range(len(BINS)) if (reference.bins == index).any()]
    lines = [
        [
            own.descriptor,
            *(
                _number(own.ratio(counted(own), counted(reference), seed, chosen))
                for chosen in (None, *there)
            ),
        ]
        for own in found
        if own is not reference
    ]
    return markdown([f"against {baseline}", "all", *(BINS[index] for index in there)], lines)


def _number(each: Estimate) -> str:
    return interval_text(each, lambda part: f"{part:.2f}")


def _speed(own: Tally, *, dense: bool) -> str:
    seconds = [row.seconds["far image"] for row in own.rows]
    if dense:
        return f"{np.median(seconds):.2f}"
    boxes = sum(row.far_boxes for row in own.rows)
    return f"{boxes / sum(seconds):.0f}" if sum(seconds) > 0 else ""


def _quotient(part: ArrayLike, whole: ArrayLike) -> Sums:
    """Divide part by whole; infinite where only the whole is 0, NaN where both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.divide(part, whole), np.float64)
