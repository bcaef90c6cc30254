"""Landmark retrieval: how often a descriptor finds a region of the near image in the far one.

A region is a proposal of the near image that the far image shows, according to the pair's true
homography. The search in the far image is among its proposals, or at every place.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nearfar.arrays import Boxes
from nearfar.bench.datasets.cases import Case, scene
from nearfar.bench.datasets.composites import random_generator
from nearfar.bench.datasets.regions import (
    LEVELS,
    proposed_at_scales,
    true_homography,
    visible_regions,
)
from nearfar.bench.runner import Task, resume
from nearfar.bench.studies.landmark_search import BoxSearch, DenseSearch, Found, RegionSearch
from nearfar.descriptors import DESCRIPTORS, DenseDescriptor, Descriptor
from nearfar.errors import SettingsError
from nearfar.imaging.image import Image, read_image
from nearfar.proposals import PROPOSERS
from nearfar.runtime.timing import StageTimer
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.feature_store import FeatureStore
from nearfar.storage.rows import Row, settings_key

Search = Literal["boxes", "dense"]
SEARCHES: tuple[Search, ...] = ("boxes", "dense")
IDENTITY = ("case", "settings", "search", "asked")
"""The columns that identify a row."""

FINE_K = 100
"""Default k of Selective Search here. With the paper's 500, few regions have a counterpart among
the boxes of the far image."""
PROPOSAL_SIZE = 1000
"""Default longest side at which boxes are proposed here, in pixels."""


@dataclass(frozen=True, eq=False)
class LandmarkTask(Task):
    """One pair, one descriptor and one kind of search.

    Attributes:
        search: kind of search.
        asked: largest number of regions to search for.
        features: folder in which proposals are stored.
    """

    search: Search
    asked: int
    features: Path


@dataclass(frozen=True)
class LandmarkResult:
    """What one kind of search found of one pair's regions with one descriptor.

    Attributes:
        case: name of the pair.
        scene: name that all pairs of a scene share.
        far: path of the far image.
        true_scale_change: scale change of the pair.
        descriptor: name of the descriptor.
        search: kind of search.
        status: "searched" or "error".
        reason: why the search failed; None where it did not.
        dimensions: values of one descriptor; None where nothing was described.
        regions: number of regions that were searched for.
        findable: for each region, whether it has a counterpart; see `Found`.
        first_correct: for each region, rank of the first correct answer, from 1, or None.
        average_precision: for each region, see `Found`.
        far_boxes: boxes of the far image that were described.
        seconds: wall time by stage.
        row: the row as it was read.
    """

    case: str
    scene: str
    far: str
    true_scale_change: float
    descriptor: str
    search: Search
    status: str
    reason: str | None
    dimensions: int | None
    regions: int
    findable: Sequence[bool]
    first_correct: Sequence[int | None]
    average_precision: Sequence[float | None]
    far_boxes: int
    seconds: Mapping[str, float]
    row: Row

    @classmethod
    def from_dict(cls, row: Row) -> "LandmarkResult":
        """Return the result in a row of `landmarks.jsonl`."""
        names = {field.name: field.name for field in fields(cls)} | {"first_correct": "first_right"}
        del names["row"]
        found: dict[str, Any] = {name: row.get(column) for name, column in names.items()}
        return cls(**found, row=row)

    def to_dict(self) -> Row:
        """Return the row for JSON."""
        return self.row


@dataclass(frozen=True, eq=False)
class Proposals:
    """The boxes of an image at several scales.

    Attributes:
        boxes: (N, 4) in pixels of the working image.
    """

    boxes: Boxes


def run_landmarks(
    cases: Sequence[Case],
    settings: Sequence[Settings],
    file: Path,
    *,
    regions: dict[Search, int],
    workers: Workers | None = None,
) -> list[LandmarkResult]:
    """Search for regions of every pair with every descriptor; see `nearfar.bench.runner.resume`.

    A descriptor without feature maps has no rows of the dense search.

    Args:
        cases: pairs with a homography.
        settings: one for each descriptor.
        file: JSON Lines, one line a pair, descriptor and kind of search. The folder `features`
            beside it holds proposals.
        regions: largest number of regions of a pair to search for, by kind of search.
        workers: processes that do the work; None: this process.

    Returns:
        The results of these pairs, settings and searches.

    Raises:
        SettingsError: a descriptor is unknown.
        WeightsError: a descriptor needs weights that are missing or do not fit.
        OSError: a row cannot be written; the rows before it are kept.
    """
    _descriptor.cache_clear()
    _searcher.cache_clear()
    finer = [finer_proposals(each) for each in settings]
    keys = [settings_key(each) for each in finer]
    dense = [has_feature_maps(each) for each in finer]
    failure: Row = {"dimensions": None, "visible": 0, "far_boxes": 0, **_columns([]), "seconds": {}}
    hashes = [case.content_hash() for case in cases]
    wanted = [
        LandmarkTask(
            case=case,
            settings=each,
            start=_start_of_row(case, each.descriptor, search, asked)
            | {"settings": key, "data": data},
            failure=failure,
            search=search,
            asked=asked,
            features=file.parent / "features",
        )
        for search, asked in regions.items()
        for each, key, maps in zip(finer, keys, dense, strict=True)
        if search == "boxes" or maps
        for case, data in zip(cases, hashes, strict=True)
    ]
    rows = resume(file, wanted, search_pair, settings=finer, identity=IDENTITY, workers=workers)
    return [LandmarkResult.from_dict(row) for row in rows]


def finer_proposals(settings: Settings) -> Settings:
    """Return the settings with this benchmark's defaults for proposals."""
    return settings.replace(
        proposal_k=settings.proposal_k or FINE_K,
        proposal_max_size=settings.proposal_max_size or PROPOSAL_SIZE,
    )


def has_feature_maps(settings: Settings) -> bool:
    """Tell whether the dense search can use the descriptor.

    Raises:
        SettingsError: the descriptor is unknown.
        WeightsError: the descriptor needs weights that are missing or do not fit.
    """
    return isinstance(_descriptor(settings), DenseDescriptor)


def search_pair(task: LandmarkTask) -> Row:
    """Search for the regions of one pair."""
    case, timer = task.case, StageTimer()
    far, near = (_read(path, task.settings) for path in (case.far, case.near))
    homography = true_homography(case, far, near)
    height, width = far.pixels.shape[:2]
    proposed = _proposals(near, task.settings, task.features)
    visible = visible_regions(proposed, homography, (width, height))
    rng = random_generator(task.settings.seed, case.name, "regions")
    drawn = visible[rng.permutation(len(visible))[: task.asked]]
    searcher = _searcher(case.far, task.settings, task.search, task.features)
    with timer.stage("regions"):
        found = searcher.find(near.pixels, drawn, homography)
    return {
        "status": "searched",
        "reason": None,
        "dimensions": searcher.dimensions,
        "visible": len(visible),
        "far_boxes": searcher.crops,
        **_columns(found),
        "seconds": {"far image": searcher.seconds, **timer.seconds},
    }


def _columns(found: Sequence[Found]) -> Row:
    return {
        "regions": len(found),
        "findable": [each.findable for each in found],
        "first_right": [each.first_correct for each in found],
        "average_precision": [each.average_precision for each in found],
    }


def _start_of_row(case: Case, descriptor: str, search: Search, asked: int) -> Row:
    return {
        "case": case.name,
        "group": case.group,
        "scene": scene(case.name),
        "far": str(case.far),
        "near": str(case.near),
        "true_scale_change": case.scale_change,
        "descriptor": descriptor,
        "search": search,
        "asked": asked,
    }


@functools.lru_cache(maxsize=1)
def _searcher(far: Path, settings: Settings, search: Search, features: Path) -> RegionSearch:
    """Prepare a far image; pairs that follow each other may share it."""
    image, descriptor = _read(far, settings), _descriptor(settings)
    if search == "boxes":
        return BoxSearch(image.pixels, _proposals(image, settings, features), descriptor)
    if not isinstance(descriptor, DenseDescriptor):
        raise SettingsError(f"the descriptor {settings.descriptor} has no feature maps")
    return DenseSearch(image.pixels, descriptor)


@functools.lru_cache(maxsize=1)
def _descriptor(settings: Settings) -> Descriptor:
    """Return the descriptor of this process."""
    return DESCRIPTORS.create(settings.descriptor, settings)


def _read(path: Path, settings: Settings) -> Image:
    return read_image(path, max_size=settings.max_size, max_pixels=settings.max_pixels)


def _proposals(image: Image, settings: Settings, folder: Path) -> Boxes:
    """Return the proposals of an image, which all descriptors share."""
    plain = settings.replace(method="paper", descriptor="hog", weights={})
    proposer = PROPOSERS.create(plain.proposer, plain)

    def compute() -> Proposals:
        return Proposals(proposed_at_scales(image.pixels, proposer, plain.proposal_max_size))

    key = f"{image.content_hash} {LEVELS}"
    return np.asarray(FeatureStore(folder).of(plain).get_or_compute(key, compute).boxes)
