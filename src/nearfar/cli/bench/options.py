"""Options and steps that several benchmarks share."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from nearfar.bench.datasets.cases import Case
from nearfar.bench.results import Result
from nearfar.bench.study import Study, run_study
from nearfar.cli.options import EACH_SETTING, Place, WeightOptions, Workplace, with_weights
from nearfar.cli.presets import AsOption, say_deviations
from nearfar.errors import SettingsError
from nearfar.methods import METHODS
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.locations import Location, Url, staged


@dataclass(frozen=True, kw_only=True, eq=False)
class _BenchSettings(Settings):
    """Settings of a benchmark, which refuses no model for chance by default."""

    method: Annotated[str, Parameter(parse=False)] = "paper"
    descriptor: Annotated[str, Parameter(parse=False)] = "nearfar"
    max_false_alarms: float = math.inf
    """Reject a model if more models as good as it are expected by chance (number of false alarms).
    inf accepts every model that the estimator gives."""
    min_confidence: float = 0.0
    """Reject a model if its calibrated confidence is below this. 0 accepts all that
    max_false_alarms accepts."""


BenchSettings = Annotated[_BenchSettings, EACH_SETTING]
"""All settings except those that are compared, each as one option."""

DEFAULTS = _BenchSettings()

_Names = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]


@Parameter(name="*", group="Run")
@dataclass(frozen=True, kw_only=True)
class RunOptions(Workplace):
    """The methods to compare, the cases, and the workers."""

    out: Place
    """Folder for the results. It may be a URL (s3://BUCKET/PATH) if the benchmark makes no images.
    A run that was stopped is resumed."""

    method: _Names = ()
    """Method to compare; may be repeated. Default: paper."""

    descriptor: _Names = ()
    """Landmark descriptor to compare; may be repeated. Default: nearfar."""

    preset: AsOption = None
    """Take the settings of the paper, or those of the code that its authors released. Options
    beside it win. They need the weights of ResNet-50."""

    weights: WeightOptions = ()
    """Weights of a network, e.g. resnet50=resnet50.pth; may be repeated."""

    sample: int = 0
    """Number of cases to use, drawn with the seed of the settings; 0: all."""

    features: Place | None = None
    """Folder that keeps the features of images between processes and runs. Default: OUT/features,
    unless OUT is a URL."""

    def local_out(self) -> Path:
        """Return the folder for results, which must be on a disk.

        Raises:
            SettingsError: the folder is a URL.
        """
        return on_disk(self.out)


def on_disk(out: Location) -> Path:
    """Return a folder on a disk.

    Raises:
        SettingsError: the folder is a URL.
    """
    if isinstance(out, Url):
        raise SettingsError(f"this needs a folder on a disk for its files, not {out}")
    return out


def run_cases(
    study: Study, cases: list[Case], options: RunOptions, settings: Settings, file_name: str
) -> list[Result]:
    """Run a study with the methods of the options on a sample of cases, in the folder of results.

    Raises:
        NearfarError: a name is unknown, weights are missing, or the workers cannot be reached.
    """
    require("bench", "matplotlib")
    workers = options.begin()
    compared, chosen = variants(settings, options), sampled(cases, options.sample, settings.seed)
    local = options.out / "features" if isinstance(options.out, Path) else None
    features = local if options.features is None else on_disk(options.features)
    say_deviations(compared, options.preset)
    return run_study(
        study,
        chosen,
        compared,
        options.out / file_name,
        workers=workers,
        features=features,
    )


def print_summary(study: Study, results: Sequence[Result], out: Location) -> None:
    """Print the tables of a study, and write its plots into the folder of results."""
    for title, table in study.tables(results).items():
        print_text(f"{title}:\n\n{table}\n")
    with staged(out) as folder:
        files = study.plots(results, folder)
    for file in files:
        print_text(f"saved {out / file.name}")


def print_text(text: str) -> None:
    """Print a text as it is."""
    Console(emoji=False, highlight=False, soft_wrap=True).print(text, markup=False)


def variants(settings: Settings, options: RunOptions) -> list[Settings]:
    """Return the settings of each method; a method with landmarks has one for each descriptor.

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
    """Draw `count` cases with a seed, and keep their order; all for 0.

    Raises:
        SettingsError: the count is negative.
    """
    if count < 0:
        raise SettingsError(f"--sample must be at least 0, not {count}")
    if count == 0 or count >= len(cases):
        return cases
    chosen = set(random.Random(seed).sample(range(len(cases)), count))  # noqa: S311
    return [case for index, case in enumerate(cases) if index in chosen]
