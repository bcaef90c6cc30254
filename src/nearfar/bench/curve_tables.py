"""Markdown tables of success against scale change."""

import numpy as np

from nearfar.bench.curves import (
    Estimate,
    Outcomes,
    bin_differences,
    bin_index,
    bin_names,
    bin_rates,
    half_success,
    scale_text,
)
from nearfar.bench.tables import markdown


def rate_table(strict: Outcomes, loose: Outcomes, seed: int) -> str:
    """Markdown: per bin and method the share of successes in percent, strict with its interval."""
    columns = []
    for method in range(len(strict.methods)):
        pairs = zip(bin_rates(strict, method, seed), bin_rates(loose, method, seed), strict=True)
        columns.append([f"{_percent(each)} / {100 * other.value:.0f}" for each, other in pairs])
    return _bin_table(strict, [f"{name}: strict / loose" for name in strict.methods], columns)


def difference_table(strict: Outcomes, seed: int) -> str:
    """Markdown: per bin the strict success of each method minus that of the first, in points."""
    columns = [
        [_percent(each, "+") for each in bin_differences(strict, method, 0, seed)]
        for method in range(1, len(strict.methods))
    ]
    titles = [f"{name} - {strict.methods[0]}" for name in strict.methods[1:]]
    return _bin_table(strict, titles, columns)


def half_table(strict: Outcomes, loose: Outcomes, seed: int) -> str:
    """Markdown: per method S50 with its interval, for strict and for loose success."""
    lines = [
        [name, *(_half(each, method, seed) for each in (strict, loose))]
        for method, name in enumerate(strict.methods)
    ]
    return markdown(["method", "S50 strict", "S50 loose"], lines)


def _bin_table(found: Outcomes, titles: list[str], columns: list[list[str]]) -> str:
    """A line for each bin that has cases: its numbers of cases and base pairs, and the columns."""
    bins = np.array([bin_index(scale) for scale in found.scales])
    lines = []
    for index, name in enumerate(bin_names()):
        cases = np.count_nonzero(bins == index)
        bases = len(np.unique(found.bases[bins == index]))
        if cases:
            lines.append([name, str(cases), str(bases), *(column[index] for column in columns)])
    return markdown(["scale change", "cases", "bases", *titles], lines)


def _percent(each: Estimate, sign: str = "") -> str:
    value, low, high = (f"{100 * part:{sign}.0f}" for part in (each.value, each.low, each.high))
    return f"{value} ({low} to {high})"


def _half(found: Outcomes, method: int, seed: int) -> str:
    each = half_success(found, method, seed)
    value, low, high = (scale_text(part, found) for part in (each.value, each.low, each.high))
    return f"{value} ({low} to {high})"
