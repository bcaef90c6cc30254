"""The learning curves of a training."""

from pathlib import Path

from nearfar.render.plotting import figure_axes, save_figure
from nearfar.storage.rows import read_rows
from nearfar.train.training import LOG


def plot_learning(folder: Path) -> Path:
    """Return losses and recall on the photographs held out, against the step.

    Returns:
        The file written, PNG.
    """
    rows = read_rows(folder / LOG)
    figure, axes = figure_axes()
    steps = [row["step"] for row in rows]
    shares = axes.twinx()
    for index, what in enumerate(("landmark", "template", "cell")):
        losses = [row[f"{what}_loss"] for row in rows]
        axes.plot(steps, losses, color=f"C{index}", label=f"{what} loss")
        recall = [row.get(f"{what}_recall") for row in rows]
        shares.plot(steps, recall, "--", color=f"C{index}", label=f"{what} recall, held out")
    axes.set(xlabel="step", ylabel="loss", ylim=(0, None))
    shares.set(ylabel="recall among all", ylim=(0, 1))
    figure.legend(loc="outside lower center", ncols=3)
    return save_figure(figure, folder / "learning_curves.png")
