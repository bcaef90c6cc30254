"""`nearfar demo`."""

import math
from dataclasses import dataclass
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn
from rich.table import Table

from nearfar.arrays import RGBPixels
from nearfar.cli.options import FAILED
from nearfar.demo import METHODS, TOLERANCE, Scene, make_scene, true_error, true_scale_change
from nearfar.localization import Localization, read_images
from nearfar.localizer import Localizer
from nearfar.render import save, save_localization, save_small
from nearfar.render.alignment import footprint_page
from nearfar.render.page import Caption, Entry


@dataclass(frozen=True, eq=False)
class Trial:
    """The answer of one method, compared with the truth.

    Attributes:
        found: the answer of the method.
        error: mean distance from the truth in far pixels; infinite without a homography.
    """

    found: Localization
    error: float

    @property
    def right(self) -> bool:
        """Whether the answer is within the tolerance."""
        return self.error <= TOLERANCE


def demo_command(*, out: Path = Path("nearfar-demo")) -> int:
    """Find a photograph on a wall of photographs by several methods, and draw pictures of it.

    Works offline, on real photographs that ship inside scikit-image.

    Exit status: 0 if a method is correct within 3 pixels, 3 if none is, 2 bad input or usage.

    Args:
        out: Folder for the images and the pictures.
    """
    console = Console(emoji=False, highlight=False)
    with _progress(console) as progress:
        step = progress.add_task("Hanging the photographs")
        scene = make_scene()
        out.mkdir(parents=True, exist_ok=True)
        far, near = save(scene.far, out / "far.png"), save(scene.near, out / "near.png")
        trials = []
        for method in METHODS:
            progress.update(step, description=f"Localizing with {method}")
            found = Localizer(method=method).localize(far, near)
            trials.append(Trial(found, true_error(scene, found)))
            save_localization(found, out / method)
    best = min(trials, key=lambda trial: trial.error)
    picture = _overview(scene, best)
    if picture is not None:
        save_small(picture, out / "demo.png")
    _report(console, scene, trials)
    console.print(f"Pictures: {out}", markup=False, soft_wrap=True)
    return 0 if best.right else FAILED


def _progress(console: Console) -> Progress:
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def _overview(scene: Scene, best: Trial) -> RGBPixels | None:
    """Draw what the best method found; None without a footprint."""
    found = f"{'Found' if best.right else 'Missed'}, {true_scale_change(scene):.1f} times smaller"
    source = "Real photographs; the far image was composed of them, so that the truth is known"
    caption = Caption(f"{found}, {best.error:.2f} pixels from the truth", (Entry(source),))
    return footprint_page(best.found, read_images(best.found), caption=caption, aligned=True)


def _report(console: Console, scene: Scene, trials: list[Trial]) -> None:
    far_height, far_width = scene.far.shape[:2]
    near_height, near_width = scene.near.shape[:2]
    console.print(
        f"Far image: {far_width} x {far_height}, a wall of photographs\n"
        f"Near image: {near_width} x {near_height}, one of them\n"
        f"True scale change: {true_scale_change(scene):.2f}x\n\n"
        "The photographs are real, from scikit-image; the wall was composed of them, so that the "
        "truth is known exactly.\n"
    )
    table = Table("method", "status", box=SIMPLE_HEAD)
    for heading in ("scale change", "inliers/matches", "true error", "seconds"):
        table.add_column(heading, justify="right")
    for trial in trials:
        found, points = trial.found, trial.found.points
        table.add_row(
            found.method,
            found.status,
            "-" if found.scale_change is None else f"{found.scale_change:.2f}x",
            f"{points.inliers.sum()}/{len(points)}",
            f"{trial.error:.2f} px" if math.isfinite(trial.error) else "-",
            f"{sum(found.seconds.values()):.1f}",
            style="bold" if trial.right else "",
        )
    console.print(table)
    for trial in trials:
        if trial.found.reason is not None:
            console.print(f"{trial.found.method}: {trial.found.reason}", markup=False)
    console.print("True error: mean distance from the truth in the far image, over the near image.")
