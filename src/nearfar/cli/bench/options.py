"""Options and steps that the benchmarks share."""

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from nearfar.bench.datasets.cases import Case
from nearfar.bench.results import Result
from nearfar.bench.runner import run
from nearfar.cli.options import EACH_SETTING, Place, WeightOptions, Workplace, with_weights
from nearfar.errors import SettingsError
from nearfar.methods import METHODS
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import Location, Url


@dataclass(frozen=True, kw_only=True, eq=False)
class _BenchSettings(Settings):
    """Settings of a benchmark: by default every model counts, as in the paper."""

    method: Annotated[str, Parameter(parse=False)] = "paper"
    descriptor: Annotated[str, Parameter(parse=False)] = "nearfar"
    max_false_alarms: float = math.inf
    """Count as a failure where so many models as good as the one found are expected by chance; inf
    accepts every model, as the paper does."""
    min_confidence: float = 0.0
    """Count as a failure where the calibrated confidence is below this; 0 accepts all that
    max_false_alarms accepts."""


BenchSettings = Annotated[_BenchSettings, EACH_SETTING]
"""All settings but those that are compared, each as one option."""

DEFAULTS = _BenchSettings()

_Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


@dataclass(frozen=True, kw_only=True)
class _RunOptions(Workplace):
    """What is compared, on how much, and where the work is done."""

    out: Place
    """Folder for the results, or URL of one (s3://BUCKET/PATH) where no images are made; a run that
    was stopped goes on where it was."""

    method: _Names = ()
    """A method to compare; may be repeated. Default: paper."""

    descriptor: _Names = ()
    """A landmark descriptor to compare; may be repeated. Default: nearfar."""

    weights: WeightOptions = ()
    """Weights of a network, e.g. resnet50=resnet50.pth; may be repeated."""

    sample: int = 0
    """Use only so many cases, drawn with the seed of the settings; 0: all."""

    features: Place | None = None
    """Folder that keeps the features of images between processes and runs; default OUT/features,
    where OUT is no URL."""

    def local_out(self) -> Path:
        """The folder for results where it has to be one that programs can open.

        Raises:
            SettingsError: it is a URL.
        """
        return on_disk(self.out)


def on_disk(out: Location) -> Path:
    """A folder that programs can open.

    Raises:
        SettingsError: it is a URL.
    """
    if isinstance(out, Url):
        raise SettingsError(f"this needs a folder on a disk for its files, not {out}")
    return out


RunOptions = Annotated[_RunOptions, Parameter(name="*", group="Run")]


def run_cases(
    cases: list[Case], options: _RunOptions, settings: Settings, name: str
) -> list[Result]:
    """Run the methods of the options over the cases; results go to OUT/`name`.jsonl.

    Raises:
        NearfarError: a name is unknown, weights are missing, or the workers cannot be reached.
    """
    require("bench", "matplotlib")
    workers = options.begin()
    local = options.out / "features" if isinstance(options.out, Path) else None
    return run(
        sampled(cases, options.sample, settings.seed),
        variants(settings, options),
        options.out / f"{name}.jsonl",
        workers=workers,
        features=local if options.features is None else on_disk(options.features),
    )


def variants(settings: Settings, options: _RunOptions) -> list[Settings]:
    """Settings of each method, of those with landmarks once for each descriptor.

    Raises:
        SettingsError: a name is unknown.
        WeightsError: a descriptor needs weights that are missing or do not fit.
    """
    common = with_weights(settings, options.weights)
    found = []
    for method in dict.fromkeys(options.method or [settings.method]):
        for descriptor in dict.fromkeys(options.descriptor or [settings.descriptor]):
            variant = common.replace(method=method, descriptor=descriptor)
            if not METHODS.create(method, variant).uses_landmarks:
                found.append(settings.replace(method=method))
                break
            found.append(variant)
    return found


def sampled(cases: list[Case], count: int, seed: int) -> list[Case]:
    """So many of the cases, drawn with a seed, in their order; all for 0.

    Raises:
        SettingsError: there are to be fewer than none.
    """
    if count < 0:
        raise SettingsError(f"--sample must be at least 0, not {count}")
    if count == 0 or count >= len(cases):
        return cases
    chosen = set(random.Random(seed).sample(range(len(cases)), count))  # noqa: S311
    return [case for index, case in enumerate(cases) if index in chosen]
