"""A server of the app as a person starts it, and a browser."""

import http.client
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit

import pytest
from PIL import Image

from tests.conftest import KnownPair

if TYPE_CHECKING:
    from selenium import webdriver

    from tests.app.browser import Page

pytest.importorskip("fastapi")
pytest.importorskip("uvicorn")
pytest.importorskip("filelock")

MEGABYTES, PIXELS = 4, 4_000_000
"""Limits of the servers in tests."""
LIMITS = ("--max-upload", str(MEGABYTES), "--max-pixels", str(PIXELS))


@dataclass(frozen=True)
class Reply:
    """What the server answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Server:
    """`nearfar app` in a process of its own."""

    folders: list[Path]
    data: Path
    host: str = "127.0.0.1"
    port: int = 0
    limits: tuple[str, ...] = LIMITS
    process: "subprocess.Popen[str] | None" = None
    address: str = ""

    def start(self) -> "Server":
        folders = map(str, self.folders)
        places = ["--host", self.host, "--port", str(self.port), "--data", str(self.data)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "nearfar", "app", *folders, *places, *self.limits],
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"},
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().removeprefix("nearfar app:").strip()
        assert self.address.startswith("http://"), self.address
        self.port = urlsplit(self.address).port or 0
        assert self.ask("GET", "/", token=False).status in (200, 401)
        return self

    def kill(self) -> None:
        """As a crash would."""
        assert self.process is not None
        self.process.send_signal(signal.SIGKILL)
        self._ended()

    def stop(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            self._ended()

    def _ended(self) -> None:
        assert self.process is not None
        self.process.wait(10)
        assert self.process.stdout is not None
        self.process.stdout.close()

    @property
    def pid(self) -> int:
        assert self.process is not None
        return self.process.pid

    def ask(
        self,
        method: str,
        path: str,
        body: Any = None,
        headers: Mapping[str, str] | None = None,
        *,
        token: bool = True,
    ) -> Reply:
        """One request; `path` is sent as it is. A body that is no bytes is sent as JSON."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        sent = dict(headers or {})
        if body is not None and not isinstance(body, bytes | Iterator):
            body = json.dumps(body).encode()
            sent.setdefault("Content-Type", "application/json")
        given = urlsplit(self.address).query.removeprefix("token=")
        if token and given:
            sent.setdefault("Authorization", f"Bearer {given}")
        try:
            chunked = isinstance(body, Iterator)
            connection.request(method, path, body, sent, encode_chunked=chunked)
            reply = connection.getresponse()
            return Reply(reply.status, dict(reply.getheaders()), reply.read())
        finally:
            connection.close()

    def get(self, path: str, **parameters: object) -> Any:
        query = "&".join(f"{name}={quote(str(value))}" for name, value in parameters.items())
        reply = self.ask("GET", f"{path}?{query}" if query else path)
        assert reply.status == 200, reply.body
        return reply.json()

    def post(self, path: str, body: Any = None) -> Any:
        reply = self.ask("POST", path, {} if body is None else body)
        assert reply.status in (200, 201), reply.body
        return reply.json()

    def send(self, file: Path) -> str:
        """Send an image; its reference."""
        reply = self.ask("POST", f"/api/images?name={quote(file.name)}", file.read_bytes())
        assert reply.status == 201, reply.body
        return str(reply.json()["ref"])

    def ref(self, path: Path) -> str:
        """The reference of a file in a served folder."""
        root = next(folder for folder in self.folders if path.is_relative_to(folder))
        listed = self.get("/api/folders")["folders"]
        base = listed[self.folders.index(root)]["ref"]
        return "/".join((base, *path.relative_to(root).parts))


def children(pid: int) -> list[int]:
    """The processes that a process has started."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the server of a module serves."""
    return tmp_path_factory.mktemp("served")


@pytest.fixture(scope="module")
def server(served: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server for the tests of a module."""
    running = Server([served], tmp_path_factory.mktemp("data")).start()
    yield running
    running.stop()


@pytest.fixture(scope="session")
def driver(tmp_path_factory: pytest.TempPathFactory) -> "Iterator[webdriver.Chrome]":
    """A browser; skips where there is none."""
    from tests.app.browser import start

    running = start(tmp_path_factory.mktemp("profile"))
    yield running
    running.quit()


@pytest.fixture
def page(server: Server, driver: "webdriver.Chrome") -> "Page":
    """A page of the server in the browser."""
    from tests.app.browser import Page

    fresh = Page(driver, server.address)
    fresh.errors()  # Those of the test before.
    return fresh


@pytest.fixture
def files(known_pair: KnownPair, served: Path) -> tuple[Path, Path]:
    """overview.png and close-up.png in the served folder."""
    paths = served / "overview.png", served / "close-up.png"
    for path, pixels in zip(paths, (known_pair.far, known_pair.near), strict=True):
        Image.fromarray(pixels).save(path)
    return paths
