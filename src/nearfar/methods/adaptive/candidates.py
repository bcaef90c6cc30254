"""Candidates: places that were proposed or fitted and not accepted.

They tell where a person may look, and what kind of failure it is.
"""

from collections.abc import Sequence

import numpy as np

from nearfar.geometry.homography import footprint
from nearfar.methods.adaptive.hypothesis import Hypothesis
from nearfar.methods.adaptive.pair import Pair
from nearfar.methods.adaptive.search import distinct
from nearfar.models import Candidate, Excluded, FailureKind

FITTED = "matches"
"""Source of homographies that were fitted to matches."""
PROPOSED = frozenset({"expected", "alignment"})
"""Sources of hypotheses that are candidates themselves, besides the search's."""


def places(pair: Pair) -> list[Hypothesis]:
    """Return the places that are worth a comparison, a few of each source.

    Args:
        pair: the images, and all that was sought and tried in them.
    """
    limits = pair.constants.candidates
    fitted = sorted(
        (each for each in pair.tried if each.source == FITTED), key=lambda each: -each.support
    )
    proposed = [each for each in pair.tried if each.source != FITTED]
    sought = sorted(pair.sought, key=lambda each: -each.support)
    chosen: list[Hypothesis] = []
    for each in (fitted, proposed, sought):
        chosen += distinct(each, pair.near.size, limits.compared, pair.constants.search)
    usable = [each for each in chosen if footprint(each.far_from_near, *pair.near.size) is not None]
    return distinct(usable, pair.near.size, len(usable), pair.constants.search)


def suspected(
    candidates: Sequence[Candidate], pair: Pair, excluded: Excluded | None
) -> FailureKind | None:
    """Return what kind of failure the evidence beside the matches speaks for; None: none.

    Args:
        candidates: the places that agree most, best first.
        pair: the images.
        excluded: what was left out as an overlay.
    """
    limits = pair.constants.candidates
    if excluded is not None:
        return "overlay"
    if not candidates or (candidates[0].score or 0) < limits.least_agreement:
        return None
    corners = footprint(candidates[0].far_from_near, *pair.near.size)
    if corners is not None and np.ptp(corners, axis=0).max() < limits.small:
        return "too-small"
    return "appearance"
