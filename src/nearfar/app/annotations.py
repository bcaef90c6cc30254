"""Annotations on disk: each change is kept as it is made."""

import re
import secrets
import time
from collections.abc import Iterable
from pathlib import Path

from fastapi import HTTPException
from pydantic import Field, ValidationError

from nearfar.app.annotation import Model, PointPairs
from nearfar.app.files import write_whole
from nearfar.app.jobs import Reference
from nearfar.app.tasks import Message

_ID = re.compile(r"[0-9a-f]{16}\.json")
Size = tuple[int, int]


class AnnotationRequest(Message):
    """Two images, by reference, in which corresponding points are to be marked."""

    far: Reference
    near: Reference


class AnnotationChange(Message):
    """The whole of what a person has marked.

    Attributes:
        version: of the annotation that was changed.
        name: of the pair.
        model: what relates the images: "homography" for a flat scene.
        points: marked so far, in pixels of the original images.
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
        far_name: to show.
        near_name: to show.
        far_size: width and height in pixels.
        near_size: the same.
        name: of the pair.
        model: what relates the images.
        points: in pixels of the original images.
        version: counts changes.
        changed: seconds since 1970.
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
        most: annotations that are kept.
    """

    def __init__(self, folder: Path, most: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._most = most
        self._all = {each.id: each for each in _read_all(folder)}

    def all(self) -> list[Annotation]:
        """The one that was changed last first."""
        return sorted(self._all.values(), key=lambda each: -each.changed)

    def get(self, annotation_id: str) -> Annotation:
        """An annotation.

        Raises:
            HTTPException: 404, there is none.
        """
        if annotation_id not in self._all:
            raise HTTPException(404, "there is no such annotation")
        return self._all[annotation_id]

    def create(
        self, request: AnnotationRequest, names: tuple[str, str], sizes: tuple[Size, Size]
    ) -> Annotation:
        """A new one without points.

        Raises:
            HTTPException: 507, there are too many.
        """
        if len(self._all) >= self._most:
            raise HTTPException(507, "there are too many annotations: delete some")
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
            HTTPException: 409, it was changed elsewhere meanwhile; 404, there is none.
        """
        known = self.get(annotation_id)
        if change.version != known.version:
            raise HTTPException(409, "this annotation was changed in another window: reload it")
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
    """A name that can be that of a folder on any system."""
    return re.sub(r"[^\w-]+", "_", name).strip("_")[:80] or "pair"


def _read_all(folder: Path) -> Iterable[Annotation]:
    for file in folder.iterdir():
        if _ID.fullmatch(file.name):
            try:
                yield Annotation.model_validate_json(file.read_bytes())
            except (OSError, ValidationError):
                file.replace(file.with_suffix(".damaged"))
