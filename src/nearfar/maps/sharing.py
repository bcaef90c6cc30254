"""Several places of one map image: each is told once, and they share the confidence."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from nearfar.maps.answers import MapAnswer

SAME_PLACE = 0.15
"""Distance of two outlines' middles up to which they are one place, as a share of the diagonal; as
for the alternatives of pairs."""


def distinct_places(answers: Iterable[MapAnswer]) -> list[MapAnswer]:
    """Return each place once, best first, with the confidence shared among those of one image.

    A query lies at one place of an image. Where the confidences of several add up to more than 1,
    each gets its part. Answers without an outline, as poses, are kept as they are.

    Args:
        answers: of one query, also of several tiles of one image.
    """
    ordered = sorted(answers, key=_order)
    of_image: dict[str, list[MapAnswer]] = {}
    kept = [each for each in ordered if each.footprint is None]
    for each in ordered:
        if each.footprint is not None:
            places = of_image.setdefault(each.image, [])
            if not any(_same(each, other) for other in places):
                places.append(each)
    for places in of_image.values():
        kept += _shared(places)
    return sorted(kept, key=_order)


def _order(answer: MapAnswer) -> tuple[float, float]:
    return -answer.confidence, -answer.votes


def _shared(places: Sequence[MapAnswer]) -> list[MapAnswer]:
    total = max(1.0, sum(each.confidence for each in places))
    return [replace(each, confidence=each.confidence / total) for each in places]


def _same(one: MapAnswer, other: MapAnswer) -> bool:
    """Return whether two outlines in one image have nearly one middle."""
    if one.footprint is None or other.footprint is None:
        return False
    diagonal = float(np.linalg.norm(np.ptp(other.footprint, axis=0)))
    away = np.linalg.norm(one.footprint.mean(axis=0) - other.footprint.mean(axis=0))
    return bool(away <= SAME_PLACE * diagonal)
