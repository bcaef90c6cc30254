"""A server of object storage on this machine."""

import logging
from collections.abc import Iterator
from datetime import timedelta
from typing import Any
from urllib.request import Request, urlopen

import pytest

from nearfar.storage import locations as storage
from nearfar.storage.locations import Url

KEY, SECRET = "AKIDEXAMPLE", "wJalrXUtnFEMIexample"


class Server:
    """S3 as `moto` imitates it, with one bucket; what is stored survives a stop.

    Attributes:
        bucket: its URL.
    """

    def __init__(self) -> None:
        self._port = 0
        self.start()
        with urlopen(Request(f"{self.endpoint}/test", method="PUT")):  # noqa: S310
            self.bucket = Url("test", "")

    @property
    def endpoint(self) -> str:
        return f"http://127.0.0.1:{self._port}"

    def start(self) -> None:
        from moto.server import ThreadedMotoServer

        self._server: Any = ThreadedMotoServer("127.0.0.1", self._port, verbose=False)
        self._server.start()
        self._port = self._server.get_host_and_port()[1]

    def stop(self) -> None:
        self._server.stop()

    def emptied(self) -> Url:
        for each in self.bucket.below():
            each.unlink()
        return self.bucket


@pytest.fixture(scope="session")
def running_server() -> Iterator[Server]:
    for module in ("moto", "flask", "flask_cors", "obstore"):
        pytest.importorskip(module)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("AWS_ACCESS_KEY_ID", KEY)
        environment.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
        environment.setenv("AWS_REGION", "us-east-1")
        environment.setattr(storage, "ATTEMPTS", 1)
        environment.setattr(storage, "PATIENCE", timedelta(seconds=1))
        environment.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:1")
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        server = Server()
        environment.setenv("AWS_ENDPOINT_URL", server.endpoint)
        yield server
        server.stop()


@pytest.fixture
def server(running_server: Server) -> Server:
    """The server with an empty bucket."""
    running_server.emptied()
    return running_server


@pytest.fixture
def bucket(server: Server) -> Url:
    return server.bucket
