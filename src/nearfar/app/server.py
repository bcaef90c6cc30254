"""The web server: routes, statuses of errors, and the socket."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import uvicorn
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from filelock import FileLock, Timeout
from starlette.responses import FileResponse, JSONResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles

from nearfar.app.configuration import AppConfiguration
from nearfar.app.connections import impatient_protocol
from nearfar.app.errors import (
    BusyError,
    ConflictError,
    IncompleteError,
    NotFoundError,
    QueueFullError,
    StoreFullError,
    TooLargeError,
    TryLaterError,
)
from nearfar.app.guard import Guard
from nearfar.app.routes import (
    Services,
    annotations,
    answers,
    batches,
    images,
    tiles,
    tracks,
    uploads,
    worlds,
)
from nearfar.errors import NearfarError, SettingsError

PAGES = ("localize", "batch", "map", "track", "results", "annotate", "kept", "world")
"""Names of the pages, as in `static/js/main.js`."""
STATIC = Path(__file__).parent / "static"
STATUSES: dict[type[Exception], int] = {
    IncompleteError: 400,
    NotFoundError: 404,
    ConflictError: 409,
    TooLargeError: 413,
    QueueFullError: 429,
    BusyError: 503,
    StoreFullError: 507,
}
"""HTTP status of each kind of `AppError`; every other `NearfarError` is bad input, 422."""
_REVALIDATED = {"Cache-Control": "no-cache"}


def create_app(configuration: AppConfiguration) -> FastAPI:
    """Create the app, which opens its data when it starts."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.services = Services.of(configuration)
        runner = asyncio.create_task(app.state.services.runner.run())
        await app.state.services.renditions.start()
        yield
        runner.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await runner
        await app.state.services.formats.close()
        await app.state.services.renditions.close()
        await app.state.services.deep_zoom.close()
        await app.state.services.worlds.close()

    app = FastAPI(
        title="nearfar", lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None
    )
    for module in (images, tiles, uploads, annotations, answers, batches, worlds, tracks):
        app.include_router(module.router)
    app.add_exception_handler(NearfarError, _refused)
    app.add_exception_handler(OSError, _not_stored)
    app.add_exception_handler(RequestValidationError, _malformed)
    app.add_exception_handler(404, _unknown)
    app.add_api_route("/", _page, include_in_schema=False)
    for name in PAGES:
        app.add_api_route(f"/{name}", _to_page, include_in_schema=False)
        app.add_api_route(f"/{name}/{{rest:path}}", _to_page, include_in_schema=False)
    app.mount("/static", _Static(directory=STATIC))
    app.add_middleware(Guard, configuration=configuration)
    return app


def serve(
    configuration: AppConfiguration, listening: socket.socket, ready: Callable[[], None]
) -> None:
    """Answer requests until the process is asked to end.

    Args:
        configuration: the options of the app.
        listening: the socket that takes connections.
        ready: is called once the folder for the data is known to be free.

    Raises:
        SettingsError: another process uses the same folder for its data.
    """
    with _only_one(configuration.data):
        ready()
        settings = uvicorn.Config(
            create_app(configuration),
            log_level="warning",
            server_header=False,
            http=impatient_protocol(configuration.limits),
            ws="none",
            timeout_keep_alive=15,
            timeout_graceful_shutdown=3,
            limit_concurrency=512,
            backlog=256,
        )
        uvicorn.Server(settings).run(sockets=[listening])


def listen(host: str, port: int) -> socket.socket:
    """Open a socket that takes connections; port 0 takes a free port.

    Raises:
        SettingsError: there is no such port, or the address cannot be used.
    """
    if not 0 <= port < 2**16:
        raise SettingsError(f"--port must be from 0 to 65535, not {port}")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=256)
    except OSError as error:
        reason = error.strerror or error
        raise SettingsError(
            f"cannot listen at {host}, port {port} ({reason}): choose another with --port"
        ) from None


def reachable(host: str) -> str:
    """Return a name under which a browser reaches a host to listen at.

    An address that stands for all of this machine is none that a browser can open.
    """
    if host not in ("0.0.0.0", "::", ""):  # noqa: S104
        return host
    family, far = (
        (socket.AF_INET6, "2001:db8::1") if host == "::" else (socket.AF_INET, "192.0.2.1")
    )
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))  # Sends nothing: it chooses the address of this machine.
            return str(probe.getsockname()[0])
        except OSError:
            return "::1" if host == "::" else "127.0.0.1"


@contextmanager
def _only_one(data: Path) -> Iterator[None]:
    data.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(data / ".lock", timeout=0):
            yield
    except Timeout:
        raise SettingsError(
            f"another nearfar app keeps its data in {data}: use that one, or choose another --data"
        ) from None


class _Static(StaticFiles):
    """Files of the front end; a browser asks whether they have changed."""

    def file_response(self, *args: object, **kwargs: object) -> Response:
        response = super().file_response(*args, **kwargs)  # type: ignore[arg-type]
        response.headers.update(_REVALIDATED)
        return response


async def _page() -> FileResponse:
    return FileResponse(STATIC / "index.html", headers=_REVALIDATED)


async def _to_page(request: Request) -> RedirectResponse:
    """Send a browser to the page that an address means: pages are named behind a #."""
    return RedirectResponse(f"/#{request.url.path}")


async def _unknown(request: Request, error: Exception) -> Response:  # noqa: ARG001
    """Answer that there is no such address, as a page unless a program asks."""
    if request.url.path.startswith("/api/"):
        return JSONResponse({"detail": "there is no such address"}, 404)
    return FileResponse(STATIC / "not-found.html", 404, headers=_REVALIDATED)


async def _refused(request: Request, error: Exception) -> Response:
    """Answer an error of nearfar in one sentence without the paths of this machine."""
    held: Services = request.app.state.services
    headers = {}
    if isinstance(error, TryLaterError):
        headers["Retry-After"] = str(error.retry_after)
    detail = held.library.without_places(str(error))
    return JSONResponse({"detail": detail}, STATUSES.get(type(error), 422), headers)


async def _not_stored(request: Request, error: Exception) -> Response:  # noqa: ARG001
    """Answer that the disk refused a file, e.g. because it is full."""
    reason = getattr(error, "strerror", None) or type(error).__name__
    return JSONResponse({"detail": f"a file could not be read or written: {reason}"}, 500)


async def _malformed(request: Request, error: Exception) -> Response:  # noqa: ARG001
    """Answer that a request is malformed, without repeating what was sent."""
    places = []
    if isinstance(error, RequestValidationError):
        places = [f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()]
    detail = "; ".join(places[:3])[:500] or "malformed"
    return JSONResponse({"detail": f"the request is not valid: {detail}"}, 422)
