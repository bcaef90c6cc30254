"""Options and steps that the benchmarks share."""

import random
from collections.abc import Sequence
from typing import Annotated

from cyclopts import Parameter

from nearfar.bench.cases import Case
from nearfar.cli.options import SettingsOptions, WeightOptions, with_weights
from nearfar.registry import METHODS
from nearfar.settings import Settings

__all__ = [
    "ACCEPT_ALL",
    "Descriptors",
    "Methods",
    "SettingsOptions",
    "WeightOptions",
    "sampled",
    "variants",
]

Methods = Annotated[tuple[str, ...], Parameter(name="--method", negative="", show_default=False)]
"""Methods to compare."""

Descriptors = Annotated[
    tuple[str, ...], Parameter(name="--descriptor", negative="", show_default=False)
]
"""Landmark descriptors to compare."""

ACCEPT_ALL = Settings(max_false_alarms=float("inf"))
"""Defaults of the benchmarks: every model counts, as in the paper."""


def variants(
    settings: Settings,
    methods: Sequence[str],
    descriptors: Sequence[str],
    weights: tuple[str, ...],
) -> list[Settings]:
    """Settings of each method, with landmarks once for each descriptor.

    Args:
        settings: what all have in common.
        methods: names of methods; where empty, that of the settings.
        descriptors: names of descriptors; where empty, that of the settings.
        weights: NAME=FILE.

    Raises:
        SettingsError: a name is unknown.
        WeightsError: a descriptor needs weights that are missing or do not fit.
    """
    common = with_weights(settings, weights)
    found = []
    for method in methods or [settings.method]:
        for descriptor in descriptors or [settings.descriptor]:
            variant = common.replace(method=method, descriptor=descriptor)
            if not METHODS.create(method, variant).uses_landmarks:
                found.append(common.replace(method=method))
                break
            found.append(variant)
    return found


def sampled(cases: list[Case], count: int, seed: int) -> list[Case]:
    """So many of the cases, drawn with a seed, in their order; all for 0."""
    if count == 0 or count >= len(cases):
        return cases
    chosen = set(random.Random(seed).sample(range(len(cases)), count))  # noqa: S311
    return [case for index, case in enumerate(cases) if index in chosen]
