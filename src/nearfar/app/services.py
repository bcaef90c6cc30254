"""The parts of the app that requests use."""

from dataclasses import dataclass

from nearfar.app.annotations import AnnotationStore
from nearfar.app.configuration import Configuration
from nearfar.app.files import Uploads
from nearfar.app.formats import Formats
from nearfar.app.jobs import Job, JobStore, LocalizeRequest
from nearfar.app.library import Library
from nearfar.app.process import LocalizeTask, LocateTask
from nearfar.app.renditions import Renditions
from nearfar.app.runner import Runner


@dataclass(frozen=True, eq=False)
class Services:
    """The parts of the app, which live as long as the server."""

    configuration: Configuration
    uploads: Uploads
    library: Library
    renditions: Renditions
    jobs: JobStore
    runner: Runner
    annotations: AnnotationStore
    formats: Formats

    @staticmethod
    def of(configuration: Configuration) -> "Services":
        """Open the folder in which the app keeps its data.

        Raises:
            OSError: it cannot be made or read.
        """
        data, limits = configuration.data, configuration.limits
        uploads = Uploads(data / "uploads", limits)
        library = Library(configuration.folders, uploads)
        jobs = JobStore(data / "jobs", limits.kept_jobs)
        renditions = Renditions(limits)
        tasks = _Tasks(library, jobs, limits.pixels)
        return Services(
            configuration,
            uploads,
            library,
            renditions,
            jobs,
            Runner(jobs, tasks.of, library.without_places, limits),
            AnnotationStore(data / "annotations", limits.annotations),
            Formats(library, limits.pixels),
        )


@dataclass(frozen=True)
class _Tasks:
    """Turns jobs, which hold references of files, into tasks, which hold paths."""

    library: Library
    jobs: JobStore
    max_pixels: int

    def of(self, job: Job) -> LocalizeTask | LocateTask:
        """Return the task for the worker of a job.

        Raises:
            NotFoundError: a file is not there any more.
        """
        request, result = job.request, self.jobs.result_file(job)
        if isinstance(request, LocalizeRequest):
            return LocalizeTask(
                far=self.library.file(request.far),
                near=self.library.file(request.near),
                model=request.model,
                max_effort=request.max_effort,
                max_pixels=self.max_pixels,
                result=result,
                matches=self.jobs.matches_file(job),
            )
        return LocateTask(
            folder=self.library.folder(request.folder),
            served=self.library.served,
            query=self.library.file(request.query),
            top=request.top,
            candidates=request.candidates,
            max_pixels=self.max_pixels,
            result=result,
        )
