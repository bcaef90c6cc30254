"""Hostile requests, and the statuses that refuse them."""

import io
import os
import pickle
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from PIL import Image

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
    "a matcher that names code": job(
        kind="localize",
        far=f"{ROOT}/near.png",
        near=f"{ROOT}/near.png",
        matcher="python:os.system",
    ),
    "a job on files outside": job(kind="localize", far="/etc/passwd", near=f"{ROOT}/../secret.png"),
    "a map outside": job(kind="locate", folder="folder/../..", query=f"{ROOT}/near.png"),
    "a camera that is followed outside": job(
        kind="track", far=f"{ROOT}/near.png", frames=f"{ROOT}/../.."
    ),
    "a far image outside for a track": job(kind="track", far="/etc/passwd", frames=ROOT),
    "frames that are endlessly many": job(
        kind="track", far=f"{ROOT}/near.png", frames=ROOT, fps=1e9
    ),
    "a camera that names a file": job(
        kind="track", far=f"{ROOT}/near.png", frames=ROOT, camera="/etc/passwd"
    ),
    "cameras that name a file": job(
        kind="localize",
        far=f"{ROOT}/near.png",
        near=f"{ROOT}/near.png",
        far_camera='{"far": "/etc/passwd", "near": null}',
    ),
    "a camera that is nested too deeply": job(
        kind="locate", folder=ROOT, query=f"{ROOT}/near.png", camera="[" * 19_000
    ),
    "a pose without cameras": job(
        kind="localize", far=f"{ROOT}/near.png", near=f"{ROOT}/near.png", model="pose"
    ),
    "a track outside": Attack("GET", f"/api/tracks?ref={ROOT}/..", (404,)),
    "a track that is none": Attack("GET", f"/api/tracks?ref={ROOT}", (404,)),
    "an export of a track outside": Attack(
        "GET", f"/api/tracks/export?ref={ROOT}/..&format=csv", (404,)
    ),
    "a frame of a file outside": Attack(
        "GET", f"/api/tracks/frame?ref={ROOT}/../secret.png&seconds=0", (404,)
    ),
    "a frame of what is no video": Attack(
        "GET", f"/api/tracks/frame?ref={ROOT}/notes.png&seconds=0", (422,)
    ),
    "a frame at no time": Attack(
        "GET", f"/api/tracks/frame?ref={ROOT}/near.png&seconds=nan", (422,)
    ),
    "a track of a job's folder": Attack("GET", "/api/jobs/..%2f..%2fuploads/track", (404,)),
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
    "a tile of a file outside": Attack(
        "GET", f"/api/images/tile?ref={ROOT}/../secret.png&level=0&column=0&row=0", (404,)
    ),
    "a tile that is far away": Attack(
        "GET", f"/api/images/tile?ref={ROOT}/near.png&level=0&column=99999999&row=0", (422,)
    ),
    "a tile that there is not": Attack(
        "GET", f"/api/images/tile?ref={ROOT}/near.png&level=0&column=0&row=9", (404,)
    ),
    "the places of a folder outside": Attack("GET", f"/api/maps/world?ref={ROOT}/..", (404,)),
    "the deletion of a folder": Attack("DELETE", "/api/uploads/..%2f..%2fjobs", (404, 405)),
    "an export of a batch's folder": Attack(
        "GET", "/api/batches/..%2f..%2fjobs/answers/export?format=csv", (404,)
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
