"""`nearfar localize` with many pairs: lines of JSON, a summary, a table and pictures."""

import json
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from nearfar.batch.answers import PairAnswer
from nearfar.batch.pairs import Pair
from nearfar.batch.placements import Overviews, write_overviews, write_table
from nearfar.batch.run import BatchWork, run
from nearfar.batch.sheet import contact_sheets
from nearfar.cli.map_exports import MapExports, Written
from nearfar.cli.options import BAD_INPUT, FAILED, WorkOptions
from nearfar.exports import CollectionExporter, Subject, exporter
from nearfar.runtime.logs import shown_progress
from nearfar.storage.locations import Location


def localize_batch(
    pairs: Sequence[Pair],
    batch: BatchWork,
    work: WorkOptions,
    out: Location | None,
    save: Path | None,
) -> int:
    """Localize many pairs, print a line for each, and return the exit status.

    The summary goes to the error output where the lines go to the output.

    Args:
        pairs: the pairs, each once.
        batch: how each pair is localized.
        work: the processes that do the work.
        out: result file; None prints the lines.
        save: folder for the table of placements and the pictures; None for none.
    """
    workers = work.begin()
    answers: list[PairAnswer] = []
    together = tuple(
        each for each in map(exporter, batch.exports) if isinstance(each, CollectionExporter)
    )
    subjects: list[tuple[str, Subject]] = []
    with shown_progress("pairs") as show:
        for answer in run(pairs, batch, out, workers, show):
            if out is None:
                sys.stdout.write(json.dumps(answer.to_dict(batch.key()), allow_nan=False) + "\n")
                sys.stdout.flush()
            _complain(answer)
            found = answer.localization
            if together and found is not None and found.localized:
                subjects.append((str(answer.pair.near), Subject(found)))
            answers.append(answer.without_matches())
    exported = Written()
    if together and save is not None:
        save.mkdir(parents=True, exist_ok=True)
        exported = MapExports(together, save, batch.dem).write(subjects)
    for failure in exported.failed:
        sys.stderr.write(f"nearfar: {failure}\n")
    lines = summary(answers)
    overviews = Overviews([], [])
    if save is not None:
        with shown_progress("pictures") as show:
            files = contact_sheets(answers, save, batch.settings, workers, show)
        overviews = write_overviews(answers, save)
        files = [*files, *overviews.files, write_table(answers, save), *exported.files]
        lines += [f"saved {file}" for file in files]
    for failure in overviews.failed:
        sys.stderr.write(f"nearfar: {failure}\n")
    stream = sys.stderr if out is None else sys.stdout
    stream.write("".join(f"{line}\n" for line in lines))
    failed = exported.failed or overviews.failed
    if failed or any(each.localization is None or each.not_exported for each in answers):
        return BAD_INPUT
    return 0 if all(answer.status == "localized" for answer in answers) else FAILED


def summary(answers: Sequence[PairAnswer]) -> list[str]:
    """Return lines that count the answers, the failures by kind, and the errors by kind."""
    counts = Counter(answer.status for answer in answers)
    lines = [
        f"{len(answers):,} pairs: {counts['localized']:,} localized, {counts['failed']:,} not "
        f"found, {counts['error']:,} errors"
    ]
    found = [answer.localization for answer in answers]
    failures = [each.failure or "unknown" for each in found if each and not each.localized]
    errors = [answer.error for answer in answers if answer.error is not None]
    for title, kinds in (("not found", failures), ("errors", errors)):
        if kinds:
            lines.append(f"{title}: {_counted(kinds)}")
    return lines


def _counted(kinds: Iterable[str]) -> str:
    return ", ".join(f"{kind} {count:,}" for kind, count in Counter(kinds).most_common())


def _complain(answer: PairAnswer) -> None:
    """Print a line for what went wrong with a pair."""
    if answer.localization is None:
        sys.stderr.write(f"nearfar: {answer.reason}\n")
    for name, reason in answer.not_exported.items():
        sys.stderr.write(f"nearfar: {answer.pair.near} not exported as {name}: {reason}\n")
