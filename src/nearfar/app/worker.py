"""The process that localizes: tasks on its standard input, reports on its standard output.

It ends as soon as its standard input is closed, also in the middle of a task, so that it never
outlives the server.
"""

import json
import os
import queue
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nearfar.app.files import write_whole
from nearfar.app.kept import write_matches
from nearfar.app.results import Step, Steps, localization_result, map_result
from nearfar.app.tasks import TASK, Ended, Entered, LocalizeTask, LocateTask, Message, Tried
from nearfar.errors import MapError, NearfarError
from nearfar.localizer import Localizer
from nearfar.maps import DEFAULTS, open_map
from nearfar.settings import Settings
from nearfar.storage.locations import Location

CACHE_BYTES = 300_000_000
"""For features of the images used last."""

Tell = Callable[[Message], None]


class Worker:
    """Does tasks; the localizer of the last settings is kept."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._localizer: Localizer | None = None

    def do(self, task: LocalizeTask | LocateTask) -> Ended:
        """Do a task; whatever goes wrong is said in the report."""
        try:
            return self._localize(task) if isinstance(task, LocalizeTask) else self._locate(task)
        except NearfarError as error:
            return Ended(error=str(error))
        except MemoryError:
            return Ended(error="the images are too large for the memory of this machine")
        except Exception as error:
            return Ended(error=f"{type(error).__name__}: {error}")

    def _localize(self, task: LocalizeTask) -> Ended:
        settings = Settings(max_effort=task.max_effort, max_pixels=task.max_pixels)
        if self._localizer is None or self._localizer.settings != settings:
            self._localizer = Localizer(settings, cache_bytes=CACHE_BYTES)
        steps = Steps(self._entered, self._tried)
        found = self._localizer.localize(task.far, task.near, model=task.model, watcher=steps)
        write_matches(task.matches, found.points)
        _write(task.result, localization_result(found, steps.best, settings))
        if not found.localized:
            return Ended(summary="not found")
        parts = [] if found.scale_change is None else [f"{found.scale_change:.1f}x larger"]
        parts += [] if found.confidence is None else [f"confidence {found.confidence:.0%}"]
        return Ended(summary=", ".join(parts), found=True)

    def _locate(self, task: LocateTask) -> Ended:
        self._entered("searching the map")
        map_ = open_map(task.folder, settings=DEFAULTS.replace(max_pixels=task.max_pixels))
        from nearfar.maps.files import file_of

        if not all(_is_served(file_of(each.name, task.folder), task) for each in map_.images):
            raise MapError(
                "the map names images outside the folders that the app serves: start it with the "
                "folder of the photographs as well"
            )
        found = map_.locate(task.query, top=task.top, candidates=task.candidates)
        files = {answer.image: str(file_of(answer.image, task.folder)) for answer in found.answers}
        _write(task.result, map_result(found, files))
        if not found.located:
            return Ended(summary="not found")
        return Ended(summary=f"in {Path(found.answers[0].image).name}", found=True)

    def _entered(self, stage: str) -> None:
        self._tell(Entered(stage=stage))

    def _tried(self, step: Step) -> None:
        agreeing = int(step.inliers.sum())
        self._tell(Tried(step=step.name, matches=len(step.far), agreeing=agreeing))


def _is_served(file: Location, task: LocateTask) -> bool:
    """Whether a file lies in a served folder, links followed."""
    return isinstance(file, Path) and any(
        file.resolve().is_relative_to(folder) for folder in task.served
    )


def main() -> None:
    """Do tasks until the standard input is closed."""
    # What libraries print must not reach the server as a report.
    reports = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(tasks,), daemon=True).start()

    def tell(message: Message) -> None:
        reports.write(message.model_dump_json() + "\n")
        reports.flush()

    worker = Worker(tell)
    while True:
        tell(worker.do(TASK.validate_json(tasks.get())))


def _read(tasks: "queue.SimpleQueue[bytes]") -> None:
    for line in sys.stdin.buffer:
        tasks.put(line)
    os._exit(0)


def _write(file: Path, content: dict[str, Any]) -> None:
    write_whole(file, json.dumps(content, allow_nan=False).encode())


if __name__ == "__main__":
    main()
