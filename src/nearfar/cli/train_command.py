"""`nearfar train`."""

import hashlib
from dataclasses import replace
from pathlib import Path

from cyclopts import App
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from nearfar.cli.options import Flag
from nearfar.runtime import require
from nearfar.storage.rows import Row

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
    jobs: int = 1,
) -> None:
    """Train the descriptor `nearfar` on all photographs in the folders PHOTOGRAPHS.

    Training needs no labels. It writes OUT/landmark_network.onnx, the learning curves
    OUT/learning_curves.png and OUT/log.jsonl. A training that was stopped goes on where it was. Use
    the result with --descriptor nearfar --weights nearfar=OUT/landmark_network.onnx. A GPU is used
    if torch finds one.

    Args:
        photographs: Folders of photographs. Folders below them are searched too.
        out: Folder for the results.
        steps: Number of batches to train on. By default 14,000, and 40 with --small.
        seed: Seed of the first weights and of the views.
        small: Train a small network on small batches, to try the command in a minute.
        jobs: Number of processes that make batches, besides the one that trains.
    """
    require("train", "torch", "matplotlib")
    from nearfar.train.export import save_model
    from nearfar.train.photographs import held_out, read_photographs
    from nearfar.train.plots import plot_learning
    from nearfar.train.training import FULL, SMALL, train

    console = Console(emoji=False, highlight=False, soft_wrap=True)
    size = SMALL if small else FULL
    configuration = replace(size, seed=seed, steps=size.steps if steps is None else steps)
    found, skipped = read_photographs(photographs)
    for line in skipped:
        console.print(f"left out: {line}", markup=False)
    training, validation = held_out(found, configuration.held_out)
    console.print(f"{len(training)} photographs to train on, {len(validation)} to validate with")
    with _progress() as progress:
        bar = progress.add_task("", total=configuration.steps)

        def show(step: int, row: Row | None) -> None:
            progress.update(bar, completed=step)
            if row is not None:
                progress.console.print(_line(row), markup=False, soft_wrap=True)

        network = train(training, validation, configuration, out, jobs=jobs, progress=show)
    model = save_model(network, out)
    digest = hashlib.sha256(model.read_bytes()).hexdigest()
    console.print(f"saved {plot_learning(out)}\nsaved {model}, SHA-256 {digest}", markup=False)


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
