"""Draws the figures of adaptive.md and quickstart.md, by the package's own steps.

    python docs/figures.py

The pair is the demo's wall of photographs at half its size and one of its photographs, which points
alone do not find. Writes into docs/images and prints the table of attempts.
"""

import io
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch, Polygon
from PIL import Image as PillowImage

import nearfar
from nearfar.arrays import Coordinates, Mask, RGBPixels
from nearfar.constants import DEFAULT
from nearfar.demo import PRINTS, TARGET, make_scene
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor
from nearfar.estimators import Task
from nearfar.features.detection import detect_rootsift
from nearfar.features.nearest import nearest_neighbours
from nearfar.geometry.homography import local_scale, outline, transform
from nearfar.imaging.mask import MaskedImage
from nearfar.imaging.warp import resized, warped
from nearfar.methods.adaptive.attempt import Attempt, attempt
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.search import Pyramid, pyramid, search, templates
from nearfar.methods.adaptive.votes import hypotheses, tentative_matches
from nearfar.methods.adaptive.zoom import Matched, Region, region
from nearfar.methods.points import tuned_estimator
from nearfar.render import save_small
from nearfar.render.alignment import footprint_page

FOLDER = Path(__file__).parent / "images"
NEAR = "retina.jpg"
DOTS_PER_INCH = 100
WIDTH = 8.4
"""Of a figure, in inches."""
RIGHT, WRONG, PLACE = "#00a6d6", "#e07a00", "#ff2882"

mpl.rcParams.update(
    {
        "font.size": 9,
        "axes.titlesize": 9,
        "axes.titlelocation": "left",
        "savefig.dpi": DOTS_PER_INCH,
    }
)


@dataclass(frozen=True, eq=False)
class Pair:
    """The pair whose localization is shown, at working size."""

    far: RGBPixels
    near: RGBPixels

    @property
    def far_size(self) -> tuple[int, int]:
        """Width and height."""
        return self.far.shape[1], self.far.shape[0]

    @property
    def near_size(self) -> tuple[int, int]:
        """Width and height."""
        return self.near.shape[1], self.near.shape[0]

    def outline(self, hypothesis: Hypothesis) -> Coordinates:
        """(4, 2) of the near image in the far one."""
        return transform(hypothesis.far_from_near, outline(*self.near_size))


@dataclass
class Attempts:
    """A watcher that keeps a row of the table for each attempt."""

    rows: list[str] = field(default_factory=list)

    def on_stage(self, stage: str) -> None:
        """Stages are not told."""

    def on_attempt(
        self,
        step: str,
        far: Coordinates,
        near: Coordinates,  # noqa: ARG002
        inliers: Mask,
        evidence: float,
    ) -> None:
        """See `nearfar.runtime.timing.Watcher`."""
        told = f"{evidence:.1f}" if np.isfinite(evidence) else "none"
        self.rows.append(f"| {step} | {len(far)} | {inliers.sum()} | {told} |")


def make_pair() -> Pair:
    """The wall at half its size, and the photograph of a retina."""
    photograph = next(each for each in PRINTS if each.file == NEAR).photograph()
    return Pair(resized(make_scene().far, 0.5)[0], photograph)


def draw_points(pair: Pair) -> None:
    """The first step: matches everywhere, hardly one of them right."""
    far, near = (detect_rootsift(each, DEFAULT.points.contrast) for each in (pair.far, pair.near))
    matched = Matched.of(far, near, nearest_neighbours(far, near), DEFAULT.points.ratio)
    found = fitted(pair, matched, "points")
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 3.6), width_ratios=[4, 3])
    show(axes[0], pair.far, f"far image, {pair.far_size[0]} x {pair.far_size[1]}")
    show(axes[1], pair.near, f"near image, {pair.near_size[0]} x {pair.near_size[1]}")
    draw_matches(axes, found.far, found.near, found.estimate.inliers)
    write(figure, "how-points")


def draw_votes(pair: Pair) -> None:
    """The places that matches vote for."""
    far, near = (detect_rootsift(each, DEFAULT.points.contrast) for each in (pair.far, pair.near))
    tentative = tentative_matches(far, near, *nearest_neighbours(far, near))
    voted = hypotheses(tentative, DEFAULT.ladder.from_votes, "votes")
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 3.6), width_ratios=[4, 3])
    show(axes[0], pair.far, f"{len(voted)} places that matches vote for, the first two in colour")
    show(axes[1], pair.near, f"{len(tentative):,} tentative matches")
    for axis, xy in zip(axes, (tentative.far, tentative.near), strict=True):
        axis.scatter(xy[:, 0], xy[:, 1], s=3, c=RIGHT, linewidths=0)
    draw_places(axes[0], pair, voted, coloured=2)
    write(figure, "how-votes")


def draw_search(pair: Pair, descriptor: DenseDescriptor) -> Hypothesis:
    """The near image sought in the pyramid; the best place of all."""
    far, sought = (
        pyramid(MaskedImage(pair.far), descriptor),
        templates(MaskedImage(pair.near), descriptor),
    )
    found = search(far, sought, pair.near_size, DEFAULT.ladder.from_search)
    scale, score = [], []
    for level in far.levels:
        alone = Pyramid([level], far.mean, far.basis)
        scale.append(level.level_from_image[0, 0])
        score.append(search(alone, sought, pair.near_size, 1)[0].support)
    figure, axes = plt.subplots(1, 3, figsize=(WIDTH, 2.9), width_ratios=[1, 3.6, 2.6])
    small, _ = resized(pair.near, 96 / max(pair.near_size))
    show(axes[0], small, f"template,\n{small.shape[1]} x {small.shape[0]}")
    show(axes[1], pair.far, f"the {len(found)} best places, the first in colour")
    draw_places(axes[1], pair, found, coloured=1)
    axes[2].plot(scale, score, "o-", color=RIGHT)
    axes[2].set_xscale("log", base=2)
    axes[2].xaxis.set_major_formatter("{x:g}")
    axes[2].set(xlabel="scale of the level", title="best score of each level of the pyramid")
    axes[2].spines[["top", "right"]].set_visible(False)
    write(figure, "how-search")
    return found[0]


def draw_zoom(pair: Pair, best: Hypothesis) -> None:
    """The region that both show by the best hypothesis, at one scale, matched again."""
    seen = region(MaskedImage(pair.far), MaskedImage(pair.near), best.far_from_near)
    if seen is None:
        raise ValueError("the best place is outside the far image")
    found = fitted(pair, seen.matches(DEFAULT.zoom.reach), best.source)
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 4.9))
    enlarged = local_scale(seen.frame_from_far, np.zeros(2))
    show(axes[0], far_seen(seen), f"far image, enlarged {enlarged:.1f} times")
    show(axes[1], seen.near_seen, "near image where the hypothesis puts it")
    xy = (transform(seen.frame_from_far, found.far), transform(seen.frame_from_near, found.near))
    draw_matches(axes, *xy, found.estimate.inliers)
    write(figure, "how-zoom")


def far_seen(seen: Region) -> RGBPixels:
    """The far image in the common frame."""
    return warped(seen.far.pixels, seen.frame_from_far, seen.size)


def draw_answer(pair: Pair) -> None:
    """What the localizer answers, and each of its attempts."""
    attempts = Attempts()
    found = nearfar.Localizer().localize(pair.far, pair.near, watcher=attempts)
    page = footprint_page(found, nearfar.read_images(found, (pair.far, pair.near)), aligned=True)
    if page is None or found.confidence is None or found.scale_change is None:
        raise ValueError(f"not localized: {found.reason}")
    save_page(page, "how-answer")
    sys.stdout.write(
        f"decided by {found.step}, confidence {found.confidence:.2f}, scale change "
        f"{found.scale_change:.1f}\n\n| step | matches | agree | evidence |\n|---|---|---|---|\n"
    )
    sys.stdout.write("\n".join(attempts.rows) + "\n")


def draw_map() -> None:
    """The demo's close-up, located in a map of the wall and of the other photographs."""
    scene = make_scene()
    whole = {each.file: each for each in PRINTS if each.part is None and each is not TARGET}
    with tempfile.TemporaryDirectory() as folder:
        photos = Path(folder) / "photos"
        photos.mkdir()
        save_small(scene.far, photos / "wall.png")
        for file, each in whole.items():
            save_small(each.photograph(), photos / f"{Path(file).stem}.png")
        map_ = nearfar.open_map(Path(folder) / "map", create=True)
        map_.add([photos])
        answer = map_.locate(scene.near).answers[0]
    save_page(answer.picture(), "map-answer")


def fitted(pair: Pair, matched: Matched, step: str) -> Attempt:
    """The homography of some matches, as the method fits it."""
    estimator = tuned_estimator(nearfar.Settings())
    return attempt([matched], Task("homography"), estimator, pair.far_size, step)


def show(axis: Axes, pixels: RGBPixels, title: str) -> None:
    """An image without ticks."""
    axis.imshow(pixels)
    axis.set(title=title, xticks=[], yticks=[], autoscale_on=False)


def draw_matches(axes: Sequence[Axes], far: Coordinates, near: Coordinates, agree: Mask) -> None:
    """Lines from the points of the first image to those of the second; those that agree on top."""
    for chosen, colour in ((~agree, WRONG), (agree, RIGHT)):
        for start, end in zip(far[chosen], near[chosen], strict=True):
            line = ConnectionPatch(
                start, end, "data", "data", axesA=axes[0], axesB=axes[1], color=colour, lw=0.7
            )
            axes[1].figure.add_artist(line)
        for axis, xy in zip(axes, (far, near), strict=True):
            x, y = xy[chosen].T
            axis.scatter(x, y, s=12, c=colour, edgecolors="black", linewidths=0.5)


def draw_places(axis: Axes, pair: Pair, places: Sequence[Hypothesis], coloured: int) -> None:
    """Outlines of the near image in the far one, the first ones coloured."""
    for rank, place in reversed(list(enumerate(places))):
        colour, width = (PLACE, 2.0) if rank < coloured else ("white", 0.8)
        axis.add_patch(Polygon(pair.outline(place), fill=False, ec=colour, lw=width))


def write(figure: Figure, name: str) -> None:
    """Write a figure as a small PNG."""
    figure.tight_layout()
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    save_page(np.asarray(PillowImage.open(drawn).convert("RGB")), name)
    plt.close(figure)


def save_page(pixels: RGBPixels, name: str) -> None:
    """Write a picture as a PNG at most as wide as the figures, with 256 colours."""
    height, width = pixels.shape[:2]
    factor = min(1.0, WIDTH * DOTS_PER_INCH / width)
    size = round(width * factor), round(height * factor)
    save_small(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), FOLDER / f"{name}.png")


def main() -> None:
    """Draw all of them."""
    pair = make_pair()
    descriptor = DESCRIPTORS.create("nearfar", nearfar.Settings())
    if not isinstance(descriptor, DenseDescriptor):
        raise TypeError("the descriptor has no feature maps")
    draw_points(pair)
    draw_votes(pair)
    draw_zoom(pair, draw_search(pair, descriptor))
    draw_answer(pair)
    draw_map()


if __name__ == "__main__":
    main()
