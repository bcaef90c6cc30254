"""Bounds of pixels, time and connections, which hold for every format and every route."""

import asyncio
import contextlib
import io
import os
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvicorn
from PIL import Image
from starlette.responses import JSONResponse

from nearfar.app.configuration import AppConfiguration, Limits
from nearfar.app.connections import impatient_protocol
from nearfar.app.files import Uploads
from nearfar.app.guard import Guard
from nearfar.app.library import PAGE, Library
from nearfar.app.renditions import LARGE, Renditions
from nearfar.errors import ImageError

SIDE = 60_000


def tiff_bomb() -> bytes:
    """A TIFF of 60000 x 60000 pixels, none of which is stored."""
    tags = [(256, SIDE), (257, SIDE), (258, 8), (259, 1), (262, 1), (273, 8), (278, SIDE)]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in [*tags, (279, 0)])
    return b"II*\0" + struct.pack("<IH", 8, len(tags) + 1) + entries + struct.pack("<I", 0)


def jpeg2000_bomb() -> bytes:
    """A JPEG 2000 file of five bands, which only GDAL reads, that says it is very large."""
    size = struct.pack(">HHIIIIIIIIH", 41 + 12, 0, SIDE, SIDE, 0, 0, SIDE, SIDE, 0, 0, 5)
    return b"\xff\x4f\xff\x51" + size + b"\x07\x01\x01" * 5


def encoded_bomb(kind: str) -> Callable[[], bytes]:
    def make() -> bytes:
        out = io.BytesIO()
        Image.new("L" if kind != "WEBP" else "RGB", (2100, 2000)).save(out, kind)
        return out.getvalue()

    return make


BOMBS = {"TIFF": tiff_bomb, "JPEG 2000": jpeg2000_bomb} | {
    kind: encoded_bomb(kind) for kind in ("JPEG", "BMP", "PPM", "WEBP")
}


def test_every_format_is_refused_by_its_pixels_before_it_is_decoded(tmp_path: Path) -> None:
    async def refused() -> None:
        renditions = Renditions(Limits(pixels=4_000_000))
        try:
            for kind, make in BOMBS.items():
                file = tmp_path / kind
                file.write_bytes(make())
                for ask in (renditions.size, renditions.png):
                    with pytest.raises(ImageError, match=f"{kind} has .* more than the limit"):
                        await ask(file)
        finally:
            await renditions.close()

    asyncio.run(refused())


def picture(file: Path, side: int) -> Path:
    Image.fromarray(np.zeros((side, side), np.uint8)).save(file)
    return file


def test_small_pictures_do_not_wait_behind_large_ones(tmp_path: Path) -> None:
    large = picture(tmp_path / "large.png", int(LARGE**0.5) + 1)
    small = picture(tmp_path / "small.png", 20)

    async def both() -> None:
        renditions = Renditions(Limits())
        try:
            process = await renditions._large.worker.start()
            os.kill(process.pid, signal.SIGSTOP)
            waiting = asyncio.create_task(renditions.jpeg(large, 320))
            assert await renditions.size(small) == (20, 20)
            assert not waiting.done()
            os.kill(process.pid, signal.SIGCONT)
            assert await waiting
        finally:
            await renditions.close()

    asyncio.run(both())


def test_a_picture_that_takes_too_long_is_given_up(tmp_path: Path) -> None:
    small = picture(tmp_path / "small.png", 20)

    async def given_up() -> None:
        renditions = Renditions(Limits(picture_seconds=0.2))
        try:
            process = await renditions._small.worker.start()
            os.kill(process.pid, signal.SIGSTOP)
            with pytest.raises(ImageError, match=r"small\.png cannot be read within"):
                await renditions.size(small)
            assert process.returncode is not None
        finally:
            await renditions.close()

    asyncio.run(given_up())


async def echo(scope: Any, receive: Any, send: Any) -> None:
    """Read a body, however slowly it comes, and answer."""
    while (await receive()).get("more_body"):
        pass
    await JSONResponse({})(scope, receive, send)


def test_slow_bodies_are_given_up_and_leave_room_for_others(tmp_path: Path) -> None:
    limits = Limits(requests=4, body_seconds=0.3)
    guard = Guard(echo, AppConfiguration((), tmp_path, limits=limits))

    async def ask(method: str, receive: Any) -> int:
        sent: list[Any] = []

        async def send(message: Any) -> None:
            sent.append(message)

        scope = {
            "type": "http", "method": method, "path": "/api/jobs", "query_string": b"",
            "headers": [(b"host", b"localhost")],
        }  # fmt: skip
        try:
            await guard(scope, receive, send)
        except Exception as error:  # What FastAPI makes an answer of.
            return int(getattr(error, "status_code", 0))
        return int(sent[0]["status"])

    async def trickle() -> Any:
        await asyncio.sleep(0.02)
        return {"type": "http.request", "body": b"x", "more_body": True}

    async def whole() -> Any:
        return {"type": "http.request", "body": b"{}"}

    async def together() -> None:
        slow = [asyncio.create_task(ask("POST", trickle)) for _ in range(2)]
        await asyncio.sleep(0.05)
        assert await ask("POST", whole) == 503
        assert await ask("GET", whole) == 200
        assert await asyncio.gather(*slow) == [408, 408]
        assert await ask("POST", whole) == 200

    asyncio.run(together())


@contextlib.contextmanager
def listening(limits: Limits) -> Iterator[int]:
    """The port of a server with limits."""
    with socket.create_server(("127.0.0.1", 0)) as opened:
        settings = uvicorn.Config(
            echo, http=impatient_protocol(limits), ws="none", lifespan="off", log_level="error"
        )
        server = uvicorn.Server(settings)
        thread = threading.Thread(target=lambda: server.run(sockets=[opened]))
        thread.start()
        try:
            yield opened.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join(10)


REQUEST = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"


def test_idle_connections_make_room_and_are_closed() -> None:
    with listening(Limits(connections=4, head_seconds=1.0)) as port:
        idle = [socket.create_connection(("127.0.0.1", port), 10) for _ in range(6)]
        idle[-1].sendall(REQUEST[:20])  # A head that is never whole.
        with socket.create_connection(("127.0.0.1", port), 10) as asking:
            asking.sendall(REQUEST)
            assert asking.recv(100).startswith(b"HTTP/1.1 200")
        for each in idle:
            with contextlib.suppress(ConnectionError):
                assert each.recv(100) == b""
            each.close()


def test_folders_of_many_files_are_listed_in_order_by_pages(tmp_path: Path) -> None:
    names = [f"{number:04}.png" for number in range(PAGE + 30)]
    for name in reversed(names):
        (tmp_path / name).touch()
    library = Library([tmp_path], Uploads(tmp_path / ".uploads", Limits()))
    ref = library.listing("").folders[0].ref
    first, second = library.listing(ref), library.listing(ref, start=PAGE)
    assert [each.name for each in (*first.images, *second.images)] == names
    assert (first.total, second.start) == (len(names), PAGE)
    chosen = library.listing(ref, "002")
    assert [each.name for each in chosen.images] == [name for name in names if "002" in name]
