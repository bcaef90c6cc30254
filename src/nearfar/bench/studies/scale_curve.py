"""Cases for curves of success against scale change, from pairs that are related by a homography.

Mode *pairs* uses the pairs as they are. Mode *scale* reduces the far image and sets it into a scene
of other photographs. Mode *tilt* tilts the far image before that. Mode *light* is mode scale with a
far image that was taken under another condition, and mode *benthic* one that was taken through 1 to
8 metres of water. Each case keeps the real change of viewpoint,
light and blur of its base pair, and the exactly mapped true points.
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
from nearfar.bench.datasets.conditions import CONDITIONS, WATERS, changed
from nearfar.bench.studies.curves import bin_name
from nearfar.errors import BenchmarkError
from nearfar.geometry.homography import scale_change, transform
from nearfar.imaging.image import read_image
from nearfar.storage.locations import replaced

Mode = Literal["pairs", "scale", "tilt", "light", "benthic"]
MODES: tuple[Mode, ...] = ("pairs", "scale", "tilt", "light", "benthic")
CHANGED: dict[Mode, tuple[str, ...]] = {"light": tuple(CONDITIONS), "benthic": tuple(WATERS)}
"""Conditions of the far images by mode; a case has one of them."""
FACTORS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)

_VERSION = "1"
"""Version of the generator; images of another version are not used."""
_KEY = "nearfar-case"
"""Name of the PNG text with the hash of everything that an image was made from."""


@dataclass(frozen=True, eq=False)
class PlannedCase:
    """A case and how to make its far image.

    Attributes:
        case: the case, with the path of its far image.
        base: the pair that it is made from.
        view: place of the base's far image in the new one; None if it is used as it is.
        condition: under which the new far image was taken; empty: as it is.
    """

    case: Case
    base: Case
    view: View | None
    condition: str = ""


def base_pairs(pairs: Iterable[Case], sets: Sequence[str] = ()) -> list[Case]:
    """Select the pairs with a homography and a known scale change, of the given sets or of all.

    Raises:
        BenchmarkError: there are no such pairs, or none in one of the sets.
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
    """Plan all cases whose total scale change is in a bin, without making images.

    Args:
        bases: pairs with a homography.
        folder: folder for the far images.
        modes: kinds of cases.
        factors: reductions of the far images (all modes but pairs), at least 1.
        seed: seed of tilts, places and conditions. The random numbers of a case depend on the seed
            and its name alone.

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
                condition = _condition(seed, name, CHANGED.get(mode, ()))
                file = folder / f"{name}.png"
                planned.append(_made(base, mode, factor, name, view, file, condition))
    return [plan for plan in planned if plan.case.group]


def make_images(plans: Iterable[PlannedCase], backgrounds: Backgrounds | None, seed: int) -> None:
    """Make the far images that are missing.

    An image gets its name when it is complete, so that an existing image is complete.

    Args:
        plans: the cases.
        backgrounds: photographs for the scenes; None if no case needs a scene.
        seed: seed of the scenes.

    Raises:
        BenchmarkError: an image exists that was made from other images or with another seed, or
            there are no backgrounds.
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
        if plan.condition:
            pixels = changed(pixels, plan.condition, rng)
        file.parent.mkdir(parents=True, exist_ok=True)
        text = PngInfo()
        text.add_text(_KEY, key)
        with replaced(file) as incomplete:
            PillowImage.fromarray(pixels).save(incomplete, "PNG", pnginfo=text, compress_level=3)


def _as_it_is(base: Case) -> PlannedCase:
    name = f"pairs/{base.name}"
    return PlannedCase(_tagged(base, "pairs", base.name, 1.0, 0.0, name=name), base, None)


def _condition(seed: int, name: str, conditions: Sequence[str]) -> str:
    """Draw the condition of a case; empty where there are none."""
    if not conditions:
        return ""
    return str(random_generator(seed, name, "condition").choice(list(conditions)))


def _made(
    base: Case, mode: Mode, factor: float, name: str, view: View, file: Path, condition: str
) -> PlannedCase:
    far_points = transform(view.scene_from_photo, base.far_points)
    moved = replace(
        base,
        far=file,
        far_points=far_points,
        scale_change=scale_change(far_points, base.near_points),
    )
    case = _tagged(moved, mode, base.name, factor, view.tilt, name=name, condition=condition)
    return PlannedCase(case, base, view, condition)


def _tagged(
    case: Case,
    mode: Mode,
    base: str,
    factor: float,
    tilt: float,
    *,
    name: str,
    condition: str = "",
) -> Case:
    total = case.scale_change or 0.0
    tags: dict[str, str | float] = {
        "mode": mode,
        "base": base,
        "factor": factor,
        "tilt": tilt,
        "total_scale": total,
    }
    if condition:
        tags["condition"] = condition
    return replace(case, name=name, group=bin_name(total) or "", tags=tags)


def _key(plan: PlannedCase, view: View, backgrounds: Backgrounds, seed: int) -> str:
    """Return the SHA-256 of everything that the far image of a case depends on."""
    photo = hashlib.sha256(plan.base.far.read_bytes()).hexdigest()
    parts = [
        _VERSION,
        str(seed),
        plan.case.name,
        photo,
        backgrounds.digest,
        repr(view.scene_from_photo.tolist()),
        *([plan.condition] if plan.condition else []),
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
