"""`nearfar train`."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from nearfar.cli.options import Flag
from nearfar.errors import SettingsError
from nearfar.runtime import require
from nearfar.storage.rows import Row

if TYPE_CHECKING:
    from nearfar.train.photographs import Photograph
    from nearfar.train.training_set import RealPair

train_app = App(name="train", help="Train the landmark descriptor.")


@train_app.command(name="descriptor")
def descriptor_command(
    photographs: list[Path],
    /,
    *,
    out: Path,
    steps: int | None = None,
    seed: int = 0,
    small: Flag = False,
    start_from: Path | None = None,
    neighbours: int = 2,
    batch_size: int | None = None,
    jobs: int = 1,
) -> None:
    """Train the descriptor `nearfar` on all photographs in the folders PHOTOGRAPHS.

    Training needs no labels. Photographs of one place that follow each other in a folder are
    found and matched first, so that the descriptor also learns from real changes. They are kept in
    OUT/pairs.npz. It writes OUT/landmark_network.onnx, the learning curves
    OUT/learning_curves.png and OUT/log.jsonl. A training that was stopped goes on where it was. Use
    the result with --descriptor nearfar --weights nearfar=OUT/landmark_network.onnx. A GPU is used
    if torch finds one.

    Args:
        photographs: Folders of photographs. Folders below them are searched too.
        out: Folder for the results.
        steps: Number of batches to train on. By default 14,000, and 40 with --small.
        seed: Seed of the first weights and of the views.
        small: Train a small network on small batches, to try the command in a minute.
        start_from: Network to go on from: a landmark_network.onnx of this command, such as the
            shipped one. The learning rate is then a quarter. By default, random weights.
        neighbours: Number of following photographs to match each one with. 0 learns from made views
            alone.
        batch_size: Number of view pairs in a batch of 64 px; half as many in one of 128 px. By
            default 384, and 16 with --small. Fewer take less time and teach less each.
        jobs: Number of processes that make batches, besides the one that trains.
    """
    require("train", "torch", "matplotlib")
    from nearfar.train.export import save_model
    from nearfar.train.photographs import read_photographs
    from nearfar.train.plots import plot_learning
    from nearfar.train.training import FULL, SMALL, train
    from nearfar.train.training_set import TrainingSet

    console = Console(emoji=False, highlight=False, soft_wrap=True)
    size = SMALL if small else FULL
    configuration = replace(size, seed=seed, steps=size.steps if steps is None else steps)
    if start_from is not None:
        configuration = configuration.further()
    if batch_size is not None:
        configuration = configuration.with_batches_of(batch_size)
    found, skipped = read_photographs(photographs)
    for line in skipped:
        console.print(f"left out: {line}", markup=False)
    pairs = _pairs(found, neighbours, out)
    training, validation = TrainingSet(found, pairs).held_out(configuration.held_out)
    for what, part in (("to train on", training), ("to validate with", validation)):
        console.print(
            f"{len(part.photographs)} photographs {what}, {len(part.pairs)} pairs of one place"
        )
    with _progress() as progress:
        bar = progress.add_task("", total=configuration.steps)

        def show(step: int, row: Row | None) -> None:
            progress.update(bar, completed=step)
            if row is not None:
                progress.console.print(_line(row), markup=False, soft_wrap=True)

        network = train(
            training, validation, configuration, out, start=start_from, jobs=jobs, progress=show
        )
    model = save_model(network, out)
    digest = hashlib.sha256(model.read_bytes()).hexdigest()
    console.print(f"saved {plot_learning(out)}\nsaved {model}, SHA-256 {digest}", markup=False)


def _pairs(photographs: "list[Photograph]", neighbours: int, out: Path) -> "tuple[RealPair, ...]":
    """Match photographs of one place, or read what was matched for this folder before."""
    from nearfar.train.mining import PAIRS, mined_pairs, read_pairs, save_pairs
    from nearfar.train.training_set import TrainingSet

    if neighbours < 0:
        raise SettingsError(f"--neighbours must be at least 0, not {neighbours}")
    if (out / PAIRS).exists():
        return read_pairs(out / PAIRS, photographs, neighbours)
    with _progress() as progress:
        bar = progress.add_task("", total=None)
        pairs = mined_pairs(
            photographs,
            neighbours,
            lambda done, total: progress.update(bar, completed=done, total=total),
        )
    out.mkdir(parents=True, exist_ok=True)
    save_pairs(out / PAIRS, TrainingSet(photographs, pairs), neighbours)
    return pairs


def _line(row: Row) -> str:
    values = [
        f"{name.replace('_', ' ')} {value:.3f}"
        for name, value in row.items()
        if name not in ("step", "seconds") and value is not None
    ]
    return f"step {row['step']}: {', '.join(values)}, {row['seconds']:.0f} s"


def _progress() -> Progress:
    terminal = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=terminal, disable=not terminal.is_terminal)
