"""Routes of the web server, one module for each kind of thing, and the parts they use."""

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request

from nearfar.app.annotations import AnnotationStore
from nearfar.app.configuration import AppConfiguration
from nearfar.app.deep_zoom import DeepZoom
from nearfar.app.files import Uploads
from nearfar.app.formats import Formats
from nearfar.app.jobs import JobStore
from nearfar.app.library import Library
from nearfar.app.renditions import Renditions
from nearfar.app.runner import Runner
from nearfar.app.world import Worlds


@dataclass(frozen=True, eq=False)
class Services:
    """The parts of the app, which live as long as the server."""

    configuration: AppConfiguration
    uploads: Uploads
    library: Library
    renditions: Renditions
    deep_zoom: DeepZoom
    jobs: JobStore
    runner: Runner
    annotations: AnnotationStore
    formats: Formats
    worlds: Worlds

    async def size(self, file: Path) -> tuple[int, int]:
        """Return width and height of an image, also of one that is shown by parts, in pixels.

        Raises:
            ImageError: it cannot be read in time, or has too many pixels.
            BusyError: too many large images wait.
        """
        if await asyncio.to_thread(self.deep_zoom.is_needed, file):
            levels = (await self.deep_zoom.open(file)).levels
            return levels.width, levels.height
        return await self.renditions.size(file)

    @staticmethod
    def of(configuration: AppConfiguration) -> "Services":
        """Open the folder in which the app keeps its data.

        Raises:
            OSError: it cannot be made or read.
        """
        data, limits = configuration.data, configuration.limits
        uploads = Uploads(data / "uploads", limits)
        library = Library(configuration.folders, uploads)
        jobs = JobStore(data / "jobs", limits.kept_jobs)
        renditions = Renditions(limits)
        return Services(
            configuration,
            uploads,
            library,
            renditions,
            DeepZoom(data / "tiles", limits),
            jobs,
            Runner(jobs, library, limits),
            AnnotationStore(data / "annotations", limits.annotations),
            Formats(library, limits),
            Worlds(library, jobs, limits),
        )


def _services(request: Request) -> Services:
    """Return the services of the app that a request was sent to."""
    found: Services = request.app.state.services
    return found


Held = Annotated[Services, Depends(_services)]
"""A parameter of a route: the services of the app."""
