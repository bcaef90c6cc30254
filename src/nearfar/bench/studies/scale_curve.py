"""Cases of success against total scale change, from pairs that are related by a homography.

Modes: *pairs*, the pairs as they are; *scale*, their far image reduced and set into a scene of
other photographs; *tilt*, the far image tilted before that. Each keeps the real change of
viewpoint, light and blur of its base pair, and its true points, mapped exactly.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from PIL import Image as PillowImage
from PIL.PngImagePlugin import PngInfo

from nearfar.bench.datasets.cases import Case
from nearfar.bench.datasets.composites import (
    Backgrounds,
    View,
    compose,
    random_generator,
    random_view,
)
from nearfar.bench.studies.curves import bin_name
from nearfar.errors import BenchmarkError
from nearfar.geometry.homography import scale_change, transform
from nearfar.imaging.image import read_image
from nearfar.storage.locations import replaced

Mode = Literal["pairs", "scale", "tilt"]
MODES: tuple[Mode, ...] = ("pairs", "scale", "tilt")
FACTORS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)

_VERSION = "1"
"""Of the generator; images of another version are not used."""
_KEY = "nearfar-case"
"""Name of the PNG text that holds what an image was made from."""


@dataclass(frozen=True, eq=False)
class PlannedCase:
    """A case and how to make its far image.

    Attributes:
        case: with the path at which its far image will be.
        base: the pair that it is made from.
        view: where the far image of the base lies in the new one; None: it is used as it is.
    """

    case: Case
    base: Case
    view: View | None


def base_pairs(pairs: Iterable[Case], sets: Sequence[str] = ()) -> list[Case]:
    """The pairs with a homography and a known scale change, of the given sets (all if empty).

    Raises:
        BenchmarkError: there are none, or none of one of the sets.
    """
    found = [
        pair
        for pair in pairs
        if pair.model == "homography" and pair.scale_change and (not sets or pair.group in sets)
    ]
    missing = sorted(set(sets) - {pair.group for pair in found})
    if not found or missing:
        of_sets = f" of the sets {', '.join(missing)}" if missing else ""
        raise BenchmarkError(f"there are no pairs with a homography{of_sets}")
    return found


def plan_cases(
    bases: Sequence[Case],
    folder: Path,
    *,
    modes: Sequence[Mode],
    factors: Sequence[float],
    seed: int,
) -> list[PlannedCase]:
    """All cases whose total scale change falls into a bin, without making images.

    Args:
        bases: pairs with a homography.
        folder: where the far images will be.
        modes: which kinds of cases.
        factors: reductions of the far images (modes scale and tilt), at least 1.
        seed: of tilts and places. Each case draws from its own random numbers, which depend on
            the seed and its name alone.

    Raises:
        BenchmarkError: a factor is below 1.
        ImageError: a far image cannot be read.
    """
    if not all(1 <= factor < float("inf") for factor in factors):
        raise BenchmarkError("every factor of a scale curve must be at least 1 and finite")
    planned = []
    for mode in modes:
        for base in bases:
            if mode == "pairs":
                planned.append(_as_it_is(base))
                continue
            far = read_image(base.far)
            for factor in dict.fromkeys(factors):
                name = f"{mode}/{base.name}/x{factor:g}"
                view = random_view(
                    far.width,
                    far.height,
                    factor,
                    tilted=mode == "tilt",
                    rng=random_generator(seed, name, "view"),
                )
                planned.append(_made(base, mode, factor, name, view, folder / f"{name}.png"))
    return [plan for plan in planned if plan.case.group]


def make_images(plans: Iterable[PlannedCase], backgrounds: Backgrounds | None, seed: int) -> None:
    """Make the far images that are missing.

    An image is written under a temporary name first, so that one that exists is complete.

    Args:
        plans: the cases.
        backgrounds: photographs for the scenes; may be None if no case needs a scene.
        seed: of the scenes.

    Raises:
        BenchmarkError: an image exists that was made from something else, or there are no
            backgrounds.
    """
    for plan in plans:
        if plan.view is None:
            continue
        if backgrounds is None:
            raise BenchmarkError("made far images need a folder of background photographs")
        file, key = plan.case.far, _key(plan, plan.view, backgrounds, seed)
        if file.exists():
            _check_key(file, key)
            continue
        rng = random_generator(seed, plan.case.name, "scene")
        scene = backgrounds.collage(plan.view.width, plan.view.height, rng)
        pixels = compose(read_image(plan.base.far).pixels, plan.view, scene)
        file.parent.mkdir(parents=True, exist_ok=True)
        text = PngInfo()
        text.add_text(_KEY, key)
        with replaced(file) as incomplete:
            PillowImage.fromarray(pixels).save(incomplete, "PNG", pnginfo=text, compress_level=3)


def _as_it_is(base: Case) -> PlannedCase:
    name = f"pairs/{base.name}"
    return PlannedCase(_tagged(base, "pairs", base.name, 1.0, 0.0, name=name), base, None)


def _made(base: Case, mode: Mode, factor: float, name: str, view: View, file: Path) -> PlannedCase:
    far_points = transform(view.scene_from_photo, base.far_points)
    moved = replace(
        base,
        far=file,
        far_points=far_points,
        scale_change=scale_change(far_points, base.near_points),
    )
    return PlannedCase(_tagged(moved, mode, base.name, factor, view.tilt, name=name), base, view)


def _tagged(case: Case, mode: Mode, base: str, factor: float, tilt: float, *, name: str) -> Case:
    total = case.scale_change or 0.0
    tags: dict[str, str | float] = {
        "mode": mode,
        "base": base,
        "factor": factor,
        "tilt": tilt,
        "total_scale": total,
    }
    return replace(case, name=name, group=bin_name(total) or "", tags=tags)


def _key(plan: PlannedCase, view: View, backgrounds: Backgrounds, seed: int) -> str:
    """SHA-256 of everything that the far image of a case depends on."""
    photo = hashlib.sha256(plan.base.far.read_bytes()).hexdigest()
    parts = [
        _VERSION,
        str(seed),
        plan.case.name,
        photo,
        backgrounds.digest,
        repr(view.scene_from_photo.tolist()),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _check_key(file: Path, key: str) -> None:
    try:
        with PillowImage.open(file) as image:
            found = image.info.get(_KEY)
    except OSError as error:
        raise BenchmarkError(f"{file} cannot be read: {error}") from error
    if found != key:
        raise BenchmarkError(
            f"{file} was made from other images or with another seed; choose another output folder"
        )
