"""Scores of the configurations of a sweep: successes, mean errors, failures and wins."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nearfar.bench.datasets.cases import scene
from nearfar.bench.results import Result
from nearfar.bench.studies.curves import Estimate, estimate_of, interval_text, resampled_weights
from nearfar.bench.summary import DASH, Share
from nearfar.bench.tables import MEASURES, distinct, log_ste, markdown
from nearfar.storage.rows import Row

NO_WEIGHTS = "weights"
"""Reason for not running a configuration: its weights are missing."""
LN_STE = "mean ln STE"
MEANS = (LN_STE, *MEASURES.values())
"""Mean errors, in the order of the tables."""
SEED = 0
"""Seed of the intervals."""


@dataclass(frozen=True)
class Score:
    """What one configuration reaches on one benchmark.

    Attributes:
        benchmark: name of the benchmark.
        method: "paper" or "objects".
        descriptor: the descriptor.
        status: whether the configuration was run.
        reason: why it was not run; None where it was.
        cases: number of cases.
        strict: number of strict successes; None where it was not run.
        loose: number of loose successes; None where it was not run.
        failures: number of cases without an answer; None where it was not run.
        wins: number of cases in which no other configuration has a smaller error: the STE, or r_err
            of a pose. Ties count for all.
        means: mean errors by name, those of `MEANS`, with 95 % intervals by bootstrap over scenes.
            A failure counts as in the paper.
    """

    benchmark: str
    method: str
    descriptor: str
    status: Literal["run", "not run"]
    reason: str | None
    cases: int
    strict: int | None = None
    loose: int | None = None
    failures: int | None = None
    wins: int | None = None
    means: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def configuration(self) -> tuple[str, str]:
        """Return method and descriptor."""
        return self.method, self.descriptor


def scores(
    benchmark: str,
    rows: Mapping[tuple[str, str], Sequence[Row]],
    configurations: Sequence[tuple[str, str]],
    cases: int,
) -> list[Score]:
    """Return the scores of all configurations.

    Args:
        benchmark: name of the benchmark.
        rows: rows of the same cases by method and descriptor; without those that were not run.
        configurations: method and descriptor of all configurations.
        cases: number of cases.
    """
    results = {each: [Result.from_dict(row) for row in own] for each, own in rows.items()}
    least = [min(map(_error, column)) for column in zip(*results.values(), strict=True)]
    found = []
    for method, descriptor in configurations:
        own = results.get((method, descriptor))
        if own is None:
            found.append(Score(benchmark, method, descriptor, "not run", NO_WEIGHTS, cases))
            continue
        found.append(
            Score(
                benchmark,
                method,
                descriptor,
                "run",
                None,
                len(own),
                strict=sum(each.strict for each in own),
                loose=sum(each.loose for each in own),
                failures=sum(not each.localized for each in own),
                wins=sum(_error(e) <= best < np.inf for e, best in zip(own, least, strict=True)),
                means=_means(own),
            )
        )
    return found


def _error(result: Result) -> float:
    """Return the error by which configurations are compared; infinite without an answer."""
    if not result.localized:
        return np.inf
    name = "r_err" if result.model == "pose" else "ste"
    error = result.measures.get(name, result.error)
    return np.inf if error is None else error


def _means(results: Sequence[Result]) -> dict[str, Estimate]:
    """Return the mean errors that the results have, with intervals over scenes."""
    values: dict[str, list[float]] = {}
    scenes: dict[str, list[str]] = {}
    for each in results:
        errors = {text: each.measures[name] for name, text in MEASURES.items() if _has(each, name)}
        if _has(each, "ste"):
            errors[LN_STE] = log_ste(each)
        for name, error in errors.items():
            values.setdefault(name, []).append(error)
            scenes.setdefault(name, []).append(_scene(each))
    return {name: _mean(values[name], scenes[name]) for name in MEANS if name in values}


def _has(result: Result, name: str) -> bool:
    return name in result.measures


def _scene(result: Result) -> str:
    """Return what the cases of a scene share: the scene, or the far frame of a drive."""
    return result.case.partition("-")[0] if result.model == "pose" else scene(result.case)


def _mean(values: Sequence[float], scenes: Sequence[str]) -> Estimate:
    bases = np.unique(np.array(scenes), return_inverse=True)[1].astype(np.intp)
    weights = resampled_weights(bases, SEED)
    drawn = weights @ np.array(values) / weights.sum(axis=1)
    return estimate_of(float(np.mean(values)), drawn)


def sweep_tables(results: Sequence[Score]) -> str:
    """Return, in Markdown, a table of each benchmark with a line for each configuration."""
    parts = []
    for benchmark in distinct(each.benchmark for each in results):
        own = [each for each in results if each.benchmark == benchmark]
        means = [name for name in MEANS if any(name in each.means for each in own)]
        lines = [_line(each, means) for each in own]
        header = [benchmark, "descriptor", "strict, %", *means, "failures", "wins"]
        parts.append(markdown(header, lines))
    return "\n\n".join(parts)


def _line(score: Score, means: Sequence[str]) -> list[str]:
    if score.strict is None:
        dashes = (len(means) + 2) * [DASH]
        return [score.method, score.descriptor, f"not run: {score.reason}", *dashes]
    share = Share(score.strict, score.cases)
    low, high = share.interval
    strict = f"{100 * share.value:.0f} ({100 * low:.0f} to {100 * high:.0f})"
    errors = (
        interval_text(score.means[name], lambda part: f"{part:.3f}")
        if name in score.means
        else DASH
        for name in means
    )
    return [
        score.method,
        score.descriptor,
        f"{score.strict} of {score.cases}: {strict}",
        *errors,
        str(score.failures),
        str(score.wins),
    ]


def write_summary(results: Sequence[Score], folder: Path) -> Path:
    """Write the scores to `sweep.json`, and return its path."""
    file = folder / "sweep.json"
    content: list[dict[str, Any]] = [asdict(result) for result in results]
    file.write_text(json.dumps(content, indent=1) + "\n")
    return file
