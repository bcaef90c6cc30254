"""Annotations: corresponding points that a person has marked."""

import math
import re
import secrets
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from nearfar.app.errors import ConflictError, NotFoundError, StoreFullError
from nearfar.app.files import write_whole
from nearfar.app.jobs import Reference
from nearfar.app.process import Message
from nearfar.arrays import Coordinates, Matrix3
from nearfar.bench.evaluate import PAPER_POINTS
from nearfar.geometry.errors import symmetric_transfer_error, transfer_errors
from nearfar.geometry.homography import normalized, scale_change

LEAST = 4
"""Number of points that determine a homography."""
LEAST_SINGULAR = 1e-5
"""Ratio of singular values below which a system of equations counts as singular."""
_ROWS = (3, 4, 3)
"""Number of proposed points in each row of the near image."""

_Pixel = Annotated[float, Field(ge=-100_000, le=1_000_000, allow_inf_nan=False)]
Point = tuple[_Pixel, _Pixel]
"""x and y in pixels of the original image."""


class PointPair(Message):
    """A point in both images; None in the image where it is not marked yet."""

    far: Point | None = None
    near: Point | None = None

    @property
    def complete(self) -> bool:
        """Whether the point is marked in both images."""
        return self.far is not None and self.near is not None


PointPairs = Annotated[tuple[PointPair, ...], Field(max_length=200)]
Model = Literal["homography", "fundamental"]


@dataclass(frozen=True)
class Agreement:
    """Comparison of all marked points with one homography.

    Attributes:
        homography: maps near to far pixels, by least squares; None where the points determine none.
        far_errors: error of each point pair in far pixels; None unless marked in both images.
        near_errors: error of each point pair in near pixels; None unless marked in both images.
        ste: symmetric transfer error, the sum of all far and near errors.
        ste_of_ten: symmetric transfer error scaled to ten points, as the paper reports it.
        scale_change: median over all pairs of points; None for fewer than two.
        reason: reason why there is no homography.
    """

    homography: list[list[float]] | None
    far_errors: list[float | None]
    near_errors: list[float | None]
    ste: float | None
    ste_of_ten: float | None
    scale_change: float | None
    reason: str | None


def arrays(points: tuple[PointPair, ...]) -> tuple[Coordinates, Coordinates]:
    """Return the (N, 2) far and near points that are marked in both images."""
    both = [(pair.far, pair.near) for pair in points if pair.far and pair.near]
    far = np.array([far for far, _ in both], np.float64).reshape(-1, 2)
    return far, np.array([near for _, near in both], np.float64).reshape(-1, 2)


def agreement(points: tuple[PointPair, ...]) -> Agreement:
    """Fit a homography to all marked points and compare it with each of them."""
    far, near = arrays(points)
    nothing: list[float | None] = [None] * len(points)
    change = scale_change(far, near)
    change = change if change is not None and math.isfinite(change) else None
    if len(far) < LEAST:
        missing = LEAST - len(far)
        reason = f"{missing} more {'point' if missing == 1 else 'points'} needed"
        return Agreement(None, nothing, nothing, None, None, change, reason)
    homography = fitted(far, near)
    if homography is None:
        reason = "the points lie on a line or contradict each other"
        return Agreement(None, nothing, nothing, None, None, change, reason)
    there = transfer_errors(homography, far, near)
    back = transfer_errors(np.linalg.inv(homography), near, far)
    ste = symmetric_transfer_error(homography, far, near)
    if not math.isfinite(ste):
        reason = "a point is mapped to infinity"
        return Agreement(None, nothing, nothing, None, None, change, reason)
    return Agreement(
        homography.tolist(),
        _spread(points, there),
        _spread(points, back),
        ste,
        ste * PAPER_POINTS / len(far),
        change,
        None,
    )


def fitted(far: Coordinates, near: Coordinates) -> Matrix3 | None:
    """Fit a homography from near to far points by least squares; None if it is undetermined."""
    if not _determine(far, near):
        return None
    found, _ = cv2.findHomography(near, far, 0)
    if found is None or not np.isfinite(found).all():
        return None
    homography = normalized(found)
    singular = np.linalg.svd(homography, compute_uv=False)
    return homography if singular[2] > 1e-12 * singular[0] else None


def _determine(far: Coordinates, near: Coordinates) -> bool:
    """Whether points determine a homography, as four do of which no three lie on a line.

    The direct linear transform (Hartley and Zisserman, 2004, chapter 4) then has rank 8.
    """
    (x, y), (u, v) = (((xy - xy.mean(axis=0)) / (xy.std() + 1e-9)).T for xy in (near, far))
    one, none = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.column_stack([x, y, one, none, none, none, -u * x, -u * y, -u]),
            np.column_stack([none, none, none, x, y, one, -v * x, -v * y, -v]),
        ]
    )
    singular = np.linalg.svd(rows, compute_uv=False)
    return bool(singular[7] > LEAST_SINGULAR * singular[0])


def targets(width: int, height: int) -> list[Point]:
    """Return ten points spread evenly over the near image, in pixels, as in the paper."""
    places: list[Point] = []
    for row, count in enumerate(_ROWS):
        y = (row + 0.5) / len(_ROWS) * height - 0.5
        places += [((column + 0.5) / count * width - 0.5, y) for column in range(count)]
    return places


def _spread(points: tuple[PointPair, ...], errors: NDArray[np.floating]) -> list[float | None]:
    values = iter(errors.tolist())
    return [next(values) if pair.complete else None for pair in points]


_ID = re.compile(r"[0-9a-f]{16}\.json")
Size = tuple[int, int]


class AnnotationRequest(Message):
    """Two images, by reference, in which corresponding points are to be marked."""

    far: Reference
    near: Reference


class AnnotationChange(Message):
    """All points that a person has marked.

    Attributes:
        version: version of the annotation that was changed.
        name: name of the pair.
        model: model that relates the images, "homography" for a flat scene.
        points: point pairs marked so far, in pixels of the original images.
    """

    version: int
    name: str = Field(min_length=1, max_length=80)
    model: Model
    points: PointPairs


class Annotation(Message):
    """Points marked in two images.

    Attributes:
        id: 16 hexadecimal digits.
        far: reference of the far image.
        near: reference of the near image.
        far_name: name of the far image, to show.
        near_name: name of the near image, to show.
        far_size: width and height of the far image in pixels.
        near_size: width and height of the near image in pixels.
        name: name of the pair.
        model: model that relates the images.
        points: point pairs, in pixels of the original images.
        version: number of changes so far.
        changed: time of the last change, seconds since 1970.
    """

    id: str
    far: str
    near: str
    far_name: str
    near_name: str
    far_size: Size
    near_size: Size
    name: str
    model: Model = "homography"
    points: PointPairs = ()
    version: int = 0
    changed: float


class AnnotationStore:
    """A folder with one file for each annotation.

    Args:
        folder: made where missing.
        most: largest number of annotations.
    """

    def __init__(self, folder: Path, most: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._most = most
        self._all = {each.id: each for each in _read_all(folder)}

    def all(self) -> list[Annotation]:
        """Return all annotations, the one changed last first."""
        return sorted(self._all.values(), key=lambda each: -each.changed)

    def get(self, annotation_id: str) -> Annotation:
        """Return an annotation.

        Raises:
            NotFoundError: there is none.
        """
        if annotation_id not in self._all:
            raise NotFoundError("there is no such annotation")
        return self._all[annotation_id]

    def create(
        self, request: AnnotationRequest, names: tuple[str, str], sizes: tuple[Size, Size]
    ) -> Annotation:
        """Create an annotation without points.

        Raises:
            StoreFullError: there are too many.
        """
        if len(self._all) >= self._most:
            raise StoreFullError("there are too many annotations: delete some")
        return self._save(
            Annotation(
                id=secrets.token_hex(8),
                far=request.far,
                near=request.near,
                far_name=names[0],
                near_name=names[1],
                far_size=sizes[0],
                near_size=sizes[1],
                name=safe_name(Path(names[1]).stem),
                changed=time.time(),
            )
        )

    def change(self, annotation_id: str, change: AnnotationChange) -> Annotation:
        """Keep what was marked.

        Raises:
            ConflictError: it was changed elsewhere meanwhile.
            NotFoundError: there is none.
        """
        known = self.get(annotation_id)
        if change.version != known.version:
            raise ConflictError("this annotation was changed in another window: reload it")
        return self._save(
            known.model_copy(
                update={
                    "name": safe_name(change.name),
                    "model": change.model,
                    "points": change.points,
                    "version": known.version + 1,
                    "changed": time.time(),
                }
            )
        )

    def delete(self, annotation_id: str) -> None:
        """Forget an annotation; what was exported stays."""
        del self._all[self.get(annotation_id).id]
        (self._folder / f"{annotation_id}.json").unlink(missing_ok=True)

    def _save(self, annotation: Annotation) -> Annotation:
        file = self._folder / f"{annotation.id}.json"
        write_whole(file, annotation.model_dump_json().encode())
        self._all[annotation.id] = annotation
        return annotation


def safe_name(name: str) -> str:
    """Return the name with characters only that folders on any system may have."""
    return re.sub(r"[^\w-]+", "_", name).strip("_")[:80] or "pair"


def _read_all(folder: Path) -> Iterable[Annotation]:
    for file in folder.iterdir():
        if _ID.fullmatch(file.name):
            try:
                yield Annotation.model_validate_json(file.read_bytes())
            except (OSError, ValidationError):
                file.replace(file.with_suffix(".damaged"))
