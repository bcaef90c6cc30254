"""The view of the world: places of images and answers, in one coordinate system."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from nearfar.app.configuration import Limits
from nearfar.app.errors import ConflictError
from nearfar.app.footprints import FindFootprints, Kind
from nearfar.app.jobs import Job, JobStore, LocateRequest
from nearfar.app.lanes import Lane
from nearfar.app.library import Library
from nearfar.imaging.georeference import WGS84

_MOST_TASKS = 6


@dataclass(frozen=True)
class Feature:
    """What is drawn of an image or an answer; see `footprints.Place`.

    Attributes:
        kind: "image", "answer" or "position".
        name: name to show.
        ref: reference of the image, to draw it; None for answers and images that are not served.
        outline: corners, or one point: longitude and latitude, or x and y.
    """

    kind: Kind
    name: str
    ref: str | None
    outline: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class World:
    """Places in one coordinate system.

    Attributes:
        system: its name; "EPSG:4326": longitude and latitude in degrees.
        features: the places; those that are known in another system alone are left out.
    """

    system: str
    features: list[Feature]


class Worlds:
    """Finds places, in a process of its own.

    Args:
        library: the served folders.
        jobs: the jobs and their answers.
        limits: bounds of time.
    """

    def __init__(self, library: Library, jobs: JobStore, limits: Limits) -> None:
        self._library = library
        self._jobs = jobs
        self._lane = Lane("nearfar.app.footprints", _MOST_TASKS, limits.picture_seconds)

    async def close(self) -> None:
        """End the process."""
        await self._lane.worker.end()

    async def of_jobs(self, jobs: Sequence[Job]) -> World:
        """Return the places of the answers of jobs that have the far image, or the map, in common.

        Raises:
            NotFoundError: a job has no answer, or its images are gone.
            ConflictError: the places cannot be read.
            BusyError: too many others ask for places.
        """
        request = jobs[0].request
        if isinstance(request, LocateRequest):
            features = _answers(self._jobs.result(jobs[0].id))
            return await self.of_map(request.folder, features)
        done = [job for job in jobs if job.status == "done"]
        answers = [(job.names[-1], self._jobs.result(job.id)["localization"]) for job in done]
        far = self._library.file(request.far)
        return await self._found(far=far, answers=tuple(answers))

    async def of_map(self, ref: str, also: Sequence[tuple[str, Feature]] = ()) -> World:
        """Return the places of the images of a map, and of others.

        Raises:
            NotFoundError: there is no such map.
            ConflictError: the places cannot be read.
            BusyError: too many others ask for places.
        """
        folder = self._library.folder(ref)
        return await self._found(also, map_folder=folder, served=self._library.served)

    async def _found(self, also: Sequence[tuple[str, Feature]] = (), **task: Any) -> World:
        with TemporaryDirectory(prefix="nearfar-places-") as folder:
            out = Path(folder) / "places.json"
            ended = await self._lane.do(FindFootprints(out=out, **task), _named(task))
            if ended.error is not None:
                raise ConflictError(ended.error)
            found = json.loads(out.read_bytes())
        known = [(each["system"], self._feature(each)) for each in found]
        return _world([*known, *also])

    def _feature(self, place: dict[str, Any]) -> Feature:
        file = place["file"]
        ref = None if file is None else self._library.reference(Path(file))
        name = place["name"].rpartition("/")[2]
        return Feature(place["kind"], name, ref, tuple(map(tuple, place["outline"])))


def _named(task: dict[str, Any]) -> Path:
    """Return the file or folder that an error of a task names."""
    found: Path = task["far"] if "far" in task else task["map_folder"]
    return found


def _answers(result: dict[str, Any]) -> list[tuple[str, Feature]]:
    """Return the places of a query by the images of a map, each with its coordinate system."""
    found = []
    for answer in result["answers"]:
        world = answer.get("world") or {}
        if "footprint" not in world:
            continue
        on_earth = world["longitude_latitude"]
        outline = tuple(map(tuple, (on_earth or world)["footprint"]))
        name = f"by {answer['image'].rpartition('/')[2]}"
        found.append(
            (world["crs"] if on_earth is None else WGS84, Feature("answer", name, None, outline))
        )
    return found


def _world(places: Iterable[tuple[str, Feature]]) -> World:
    """Return the places in longitude and latitude; where there are none, those of one system."""
    known = list(places)
    systems = [system for system, _ in known]
    system = WGS84 if WGS84 in systems or not systems else systems[0]
    return World(system, [feature for each, feature in known if each == system])
