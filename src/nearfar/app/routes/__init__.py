"""Routes of the web server, one module for each kind of thing, and the parts they use."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from nearfar.app.annotations import AnnotationStore
from nearfar.app.configuration import AppConfiguration
from nearfar.app.files import Uploads
from nearfar.app.formats import Formats
from nearfar.app.jobs import JobStore
from nearfar.app.library import Library
from nearfar.app.renditions import Renditions
from nearfar.app.runner import Runner


@dataclass(frozen=True, eq=False)
class Services:
    """The parts of the app, which live as long as the server."""

    configuration: AppConfiguration
    uploads: Uploads
    library: Library
    renditions: Renditions
    jobs: JobStore
    runner: Runner
    annotations: AnnotationStore
    formats: Formats

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
            jobs,
            Runner(jobs, library, limits),
            AnnotationStore(data / "annotations", limits.annotations),
            Formats(library, limits.pixels),
        )


def _services(request: Request) -> Services:
    """Return the services of the app that a request was sent to."""
    found: Services = request.app.state.services
    return found


Held = Annotated[Services, Depends(_services)]
"""A parameter of a route: the services of the app."""
