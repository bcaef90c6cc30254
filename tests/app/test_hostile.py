"""Hostile requests against a real server: each is refused, and the server goes on answering."""

import asyncio
import json
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from starlette.responses import JSONResponse

from nearfar.app.configuration import AppConfiguration
from nearfar.app.guard import Guard
from tests.app.attacks import ATTACKS, MEGABYTE, ROOT, UNPICKLED, Attack, picture, png
from tests.app.conftest import Server


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
