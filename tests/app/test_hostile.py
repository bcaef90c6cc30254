"""Hostile requests against a real server: each is refused, and the server goes on answering."""

import asyncio
import io
import json
import os
import pickle
import socket
import struct
import tempfile
import threading
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image
from starlette.responses import JSONResponse

from nearfar.app.configuration import AppConfiguration
from nearfar.app.guard import Guard
from tests.app.conftest import MEGABYTES, Reply, Server

MEGABYTE = 1_000_000
JSON = (("Content-Type", "application/json"),)
UNPICKLED = Path(tempfile.gettempdir()) / "unpickled-by-nearfar-app"


def png(width: int = 64, height: int = 48) -> bytes:
    out = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    Image.fromarray(noise).save(out, "PNG")
    return out.getvalue()


def bomb(width: int, height: int) -> bytes:
    """A small PNG that says it has very many pixels, all of them there."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    rows = zlib.compress(bytes((width // 8 + 1) * height), 9)
    start = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    return start + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


class Payload:
    """Writes a file where it is unpickled."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return os.mkdir, (str(self.target),)


@dataclass(frozen=True)
class Attack:
    """A request and the statuses that refuse it."""

    method: str
    path: str
    refused: tuple[int, ...]
    body: Any = None
    headers: tuple[tuple[str, str], ...] = ()

    def send(self, server: Server) -> Reply:
        body = self.body() if callable(self.body) else self.body
        return server.ask(self.method, self.path, body, dict(self.headers))


def picture(ref: str) -> Attack:
    return Attack("GET", f"/api/images/picture?ref={quote(ref, safe='')}", (404,))


def image(body: Any, *refused: int) -> Attack:
    return Attack("POST", "/api/images?name=a.png", refused, body)


def job(**request: Any) -> Attack:
    return Attack("POST", "/api/jobs", (404, 422), request)


def long_stream() -> Iterator[bytes]:
    for _ in range(3 * MEGABYTES):
        yield bytes(MEGABYTE // 2)


ROOT = "ROOT"
"""Stands for the reference of the served folder."""
ANNOTATION = "/api/annotations/ANNOTATION"

ATTACKS = {
    "climb out of a folder": picture(f"{ROOT}/../secret.png"),
    "climb out, encoded twice": picture(f"{ROOT}/%2e%2e/secret.png"),
    "an absolute path": picture("/etc/passwd"),
    "an absolute path in a folder": picture(f"{ROOT}//etc/passwd"),
    "a link that leads out": picture(f"{ROOT}/link.png"),
    "a hidden file": picture(f"{ROOT}/.hidden.png"),
    "a null byte": picture(f"{ROOT}/near.png\0.jpg"),
    "backslashes": picture(f"{ROOT}\\..\\secret.png"),
    "an upload that is a path": picture("upload/../../secret.png"),
    "a folder that is not served": picture("folder/0000000000/near.png"),
    "the program's own files": Attack("GET", "/static/..%2f..%2fserver.py", (404,)),
    "the program's own files, plainly": Attack("GET", "/static/../server.py", (404,)),
    "a file that is no image": Attack("GET", f"/api/images/picture?ref={ROOT}/notes.png", (422,)),
    "an image that is too large": image(bytes(MEGABYTES * MEGABYTE + 1), 413),
    "an endless stream": image(long_stream, 413),
    "a decompression bomb": image(lambda: bomb(60_000, 60_000), 422),
    "a bomb just over the limit": image(lambda: bomb(2048, 2048), 422),
    "a page for an image": image(b"<html><script>alert(1)</script></html>", 422),
    "an SVG for an image": image(b"<svg xmlns='http://www.w3.org/2000/svg'/>", 422),
    "half an image": image(lambda: png()[:900], 422),
    "nothing for an image": image(b"", 422),
    "a pickle for an image": image(lambda: pickle.dumps(Payload(UNPICKLED)), 422),
    "another site's name": Attack("GET", "/", (421,), headers=(("Host", "evil.example"),)),
    "another site's page": Attack(
        "POST", "/api/jobs", (403,), {}, headers=(("Origin", "http://evil.example"),)
    ),
    "a page without a site": Attack("POST", "/api/jobs", (403,), {}, (("Origin", "null"),)),
    "an image in another site's page": Attack(
        "GET", "/api/jobs", (403,), headers=(("Sec-Fetch-Site", "cross-site"),)
    ),
    "a form of another kind": Attack(
        "POST", "/api/jobs", (403, 415, 422), b"{}", (("Content-Type", "text/plain"),)
    ),
    "JSON that is too long": Attack("POST", "/api/agreement", (413,), bytes(2 * MEGABYTE)),
    "JSON that is too deep": Attack(
        "POST",
        "/api/agreement",
        (400, 422),
        b"[" * 100_000,
        JSON,
    ),
    "JSON that is none": Attack("POST", "/api/agreement", (422,), b"{]", JSON),
    "points that are no numbers": Attack(
        "POST",
        "/api/agreement",
        (422,),
        b'{"points": [{"far": [NaN, 1], "near": [1, Infinity]}]}',
        JSON,
    ),
    "very many points": Attack(
        "POST", "/api/agreement", (422,), {"points": [{"far": [1, 1], "near": [1, 1]}] * 5000}
    ),
    "settings that are not offered": job(
        kind="localize", far=f"{ROOT}/near.png", near=f"{ROOT}/near.png", weights={"nearfar": "x"}
    ),
    "a job on files outside": job(kind="localize", far="/etc/passwd", near=f"{ROOT}/../secret.png"),
    "a map outside": job(kind="locate", folder="folder/../..", query=f"{ROOT}/near.png"),
    "a job of an unknown kind": job(kind="shell", command="id"),
    "a job's folder": Attack("GET", "/api/jobs/..%2f..%2fuploads/result", (404,)),
    "a frame that is too large": Attack(
        "GET",
        f"/api/images/warped?ref={ROOT}/near.png&width=90000&height=90000" + "&h=1" * 9,
        (422,),
    ),
    "a homography that maps all to a point": Attack(
        "GET", f"/api/images/warped?ref={ROOT}/near.png&width=9&height=9" + "&h=0" * 9, (422,)
    ),
    "a homography that is not finite": Attack(
        "GET", f"/api/images/warped?ref={ROOT}/near.png&width=9&height=9" + "&h=nan" * 9, (422,)
    ),
    "results in a folder outside": Attack("GET", f"/api/runs?ref={ROOT}/..", (404,)),
    "an export to a folder outside": Attack(
        "POST", f"{ANNOTATION}/add", (404,), {"folder": f"{ROOT}/.."}
    ),
    "an export of results in a folder outside": Attack(
        "GET", f"/api/runs/export?ref={ROOT}/..&index=0&case=a&method=b&format=csv", (404,)
    ),
    "an export of a job's folder": Attack(
        "GET", "/api/jobs/..%2f..%2fuploads/export?format=csv", (404,)
    ),
    "an export of very many formats": Attack(
        "GET",
        f"/api/runs/export?ref={ROOT}&index=0&case=a&method=b" + "&format=csv" * 50,
        (422,),
    ),
    "an export of too few points": Attack("GET", f"{ANNOTATION}/export?layout=pair", (409,)),
    "a method that there is not": Attack("PATCH", "/api/jobs", (405,)),
    "a length that is no number": Attack(
        "POST", "/api/agreement", (400,), b"", (("Content-Length", "-5"),)
    ),
}


@pytest.fixture(scope="module")
def names(server: Server, served: Path) -> dict[str, str]:
    """What stands for references in the attacks."""
    outside = served.parent / "secret.png"
    outside.write_bytes(png())
    for name in ("near.png", ".hidden.png"):
        (served / name).write_bytes(png())
    (served / "link.png").symlink_to(outside)
    (served / "notes.png").write_text("root:x:0:0")
    root = server.get("/api/folders")["folders"][0]["ref"]
    pair = {"far": f"{root}/near.png", "near": f"{root}/near.png"}
    note = server.post("/api/annotations", pair)["annotation"]["id"]
    return {ROOT: root, "ANNOTATION": note}


def with_names(value: Any, names: dict[str, str]) -> Any:
    if isinstance(value, str):
        for placeholder, name in names.items():
            value = value.replace(quote(placeholder), name)
        return value
    if isinstance(value, dict):
        return {key: with_names(each, names) for key, each in value.items()}
    return value


@pytest.mark.parametrize("name", ATTACKS)
def test_hostile_requests_are_refused(name: str, server: Server, names: dict[str, str]) -> None:
    attack = ATTACKS[name]
    path, body = with_names(attack.path, names), with_names(attack.body, names)
    reply = Attack(attack.method, path, attack.refused, body, attack.headers).send(server)
    assert reply.status in attack.refused, (reply.status, reply.body[:300])
    if reply.headers["content-type"] == "application/json":
        assert isinstance(json.loads(reply.body)["detail"], str)
    assert str(server.data).encode() not in reply.body
    assert str(server.folders[0]).encode() not in reply.body
    assert server.ask("GET", "/api/about").status == 200
    assert not UNPICKLED.exists()
    assert not list((server.data / "uploads").glob(".incoming-*"))


@pytest.mark.parametrize("host", ["127.0.0.2:80", "localhost", "[::1]:80", "LOCALHOST:1"])
def test_every_name_of_this_machine_alone_is_its_own(server: Server, host: str) -> None:
    assert server.ask("GET", "/api/about", headers={"Host": host}).status == 200


def test_pages_may_load_nothing_from_elsewhere(server: Server) -> None:
    for path in ("/", "/static/js/main.js", "/static/app.css", "/api/about"):
        headers = server.ask("GET", path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"


def test_a_sender_that_stalls_holds_nobody_up(server: Server) -> None:
    start = b"POST /api/images?name=a HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9999\r\n\r\nx"
    stalled = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(8)]
    try:
        for connection in stalled:
            connection.sendall(start)
        assert server.ask("GET", "/api/about").status == 200
        assert server.ask("POST", "/api/agreement", {"points": []}).status == 200
    finally:
        for connection in stalled:
            connection.close()


def test_a_flood_leaves_the_server_answering_in_bounded_memory(
    server: Server, names: dict[str, str]
) -> None:
    root = names[ROOT]
    noise = png(1000, 900)
    uploads = Attack("POST", "/api/images?name=flood.png", (), noise)
    far = {"far": f"{root}/near.png", "near": f"{root}/near.png", "max_effort": "points"}
    jobs = Attack("POST", "/api/jobs", (), {"kind": "localize"} | far)
    warps = Attack(
        "GET",
        f"/api/images/warped?ref={root}/near.png&width=1500&height=1500"
        "&h=20&h=0&h=0&h=0&h=20&h=0&h=0&h=0&h=1",
        (),
    )
    kinds = [uploads, jobs, warps, picture(f"{root}/near.png"), Attack("GET", "/api/jobs", ())]
    before = memory(server)
    together = threading.Barrier(200)

    def one(number: int) -> int:
        together.wait()
        try:
            return kinds[number % len(kinds)].send(server).status
        except OSError:
            return 0

    with ThreadPoolExecutor(200) as pool:
        statuses = list(pool.map(one, range(200)))
    assert set(statuses) <= {0, 200, 201, 429, 503}, sorted(set(statuses))
    assert statuses.count(0) < 10
    assert sum(status in (200, 201) for status in statuses) >= 20
    assert memory(server) - before < 300 * MEGABYTE
    assert server.ask("GET", "/api/about").status == 200
    waiting = [each for each in server.get("/api/jobs") if each["status"] in ("waiting", "running")]
    assert len(waiting) <= 13
    assert len(list((server.data / "uploads").iterdir())) < 10


def memory(server: Server) -> int:
    """The most memory that the server has used so far, in bytes."""
    status = Path(f"/proc/{server.pid}/status").read_text()
    line = next(each for each in status.splitlines() if each.startswith("VmHWM"))
    return int(line.split()[1]) * 1024


def test_other_machines_need_the_token(served: Path, tmp_path: Path) -> None:
    server = Server([served], tmp_path / "data", host="0.0.0.0").start()  # noqa: S104
    try:
        token = server.address.partition("?token=")[2]
        assert len(token) > 20
        for path in ("/", "/api/jobs", "/static/js/main.js", "/?token=wrong"):
            assert server.ask("GET", path, token=False).status == 401
        entered = server.ask("GET", f"/?token={token}", token=False)
        cookie = entered.headers["set-cookie"]
        assert entered.status == 303
        assert "HttpOnly" in cookie
        assert "strict" in cookie.lower()
        with_cookie = {"Cookie": cookie.split(";")[0]}
        assert server.ask("GET", "/api/jobs", None, with_cookie, token=False).status == 200
        assert server.ask("GET", "/api/jobs").status == 200
        wrong = {"Authorization": f"Bearer {token}x"}
        assert server.ask("GET", "/api/jobs", None, wrong).status == 401
    finally:
        server.stop()


@pytest.mark.parametrize(
    "others",
    [
        "{0}",
        'other={{"a": [1, 2]}}; {0}',
        "other=a b@c; {0}",
        "; =; a/b[]=\u00fc; {0}; {{}}",
        "nearfar-token=of-another-version; {0}",
        "nearfar-token-{1}=of-another-path; {0}",
        "{0}; nearfar-token-{1}=of-another-path",
        "nearfar-token-1=of-another-port; {0}",
    ],
)
@pytest.mark.parametrize("token", ["secret-secret", 'a "secret"; with=%20 \\, all'])
def test_cookies_of_other_programs_lock_nobody_out(tmp_path: Path, others: str, token: str) -> None:
    """Browsers send the cookies of all ports of a host to each."""
    configuration = AppConfiguration((), tmp_path, host="0.0.0.0", token=token)  # noqa: S104

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        await JSONResponse({})(scope, receive, send)

    def ask(path: str, cookie: str) -> tuple[int, str]:
        headers = [(b"host", b"here:8000"), (b"cookie", cookie.encode("latin-1"))]
        name, _, query = path.partition("?")
        scope = {
            "type": "http", "method": "GET", "path": name, "query_string": query.encode(),
            "headers": headers, "server": ("127.0.0.1", 8000),
        }  # fmt: skip
        sent: list[Any] = []

        async def send(message: Any) -> None:
            sent.append(message)

        async def receive() -> Any:
            return {"type": "http.request", "body": b""}

        asyncio.run(Guard(inner, configuration)(scope, receive, send))
        said = dict(sent[0]["headers"])
        return sent[0]["status"], said.get(b"set-cookie", b"").decode()

    status, cookie = ask(f"/?token={quote(token, safe='')}", "")
    assert status == 303
    own = cookie.split(";")[0]
    assert ask("/api/jobs", others.format(own, 8000))[0] == 200
    assert ask("/api/jobs", others.format("a=b", 8000))[0] == 401
    assert ask("/api/jobs", others.format(f"{own}x", 8000))[0] == 401
