"""Studies: benchmarks that compare methods on cases from a folder. This is a kind of plug-in."""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

from nearfar.bench.datasets.cases import Case
from nearfar.bench.results import Result
from nearfar.bench.runner import localized_columns, run
from nearfar.bench.tables import success_table, time_table
from nearfar.localizer import Localizer
from nearfar.registry import EXTERNAL, Registry, source_hash
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.locations import Location
from nearfar.storage.rows import Row


class Study(ABC):
    """Compares methods on cases from a folder. Only `cases` has to be written for a new study.

    Args:
        name: name of the study.
        settings: settings of the command that runs it.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self.name = name
        self.settings = settings

    @property
    def file_name(self) -> str:
        """Name of the result file in the folder of results."""
        return re.sub(r"[^\w.-]", "_", self.name.removeprefix(EXTERNAL)) + ".jsonl"

    @abstractmethod
    def cases(self, folder: Path) -> list[Case]:
        """Find the cases in a folder.

        Args:
            folder: the folder that the user names.

        Returns:
            At least one case; each has a name of its own.

        Raises:
            BenchmarkError: there are no cases, or one cannot be read.
        """

    def measure(self, case: Case, localizer: Localizer) -> Row:
        """Run one method on one case, in a worker. By default, localize and compare with the truth.

        Args:
            case: the case.
            localizer: the method.

        Returns:
            Columns of the row for JSON. `strict` and `loose` say whether the case is a success. An
            exception of this method is recorded in the row, and the run goes on.
        """
        return localized_columns(case, localizer)

    def tables(self, results: Sequence[Result]) -> dict[str, str]:
        """Summarize results in Markdown tables by their titles, for the terminal."""
        return {
            "Successes, strict / loose": success_table(results),
            "Median seconds by stage, where it ran": time_table(results),
        }

    def plots(self, results: Sequence[Result], folder: Path) -> list[Path]:  # noqa: ARG002
        """Write plots of results into a folder, and return their paths. By default, there are none.

        Args:
            results: results of all methods.
            folder: where to write.
        """
        return []


STUDIES: Registry[Study] = Registry("study", "nearfar.bench.studies")


def run_study(
    study: Study,
    cases: Sequence[Case],
    settings: Sequence[Settings],
    file: Location,
    *,
    workers: Workers | None = None,
    features: Path | None = None,
) -> list[Result]:
    """Run a study on some of its cases; see `nearfar.bench.runner.resume`.

    A row is computed again where the source file of a study from outside this package has changed.

    Args:
        study: the study.
        cases: the cases.
        settings: one for each method to compare.
        file: JSON Lines, one line a case and setting; made where missing.
        workers: where the work is done; None: this process.
        features: folder in which features of images are kept between processes and runs.

    Raises:
        BenchmarkError: the file holds something else than results.
        OSError: a result cannot be written; those before it are kept.
    """
    module = type(study).__module__
    code = "" if module.startswith("nearfar.") else source_hash(module)
    return run(
        cases,
        settings,
        file,
        workers=workers,
        features=features,
        measure=study.measure,
        code=code,
    )
