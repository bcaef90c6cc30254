"""Use the app for a long time, and see whether memory, open files, processes or files pile up.

    python benchmarks/app_soak.py --minutes 120 --out soak.jsonl

Starts `nearfar app` with made images, and does at random what people do: localize, cancel while it
runs, follow a camera, run a batch, send images, look at pictures, export, annotate, reload, delete.
After each round a line of OUT has memory and open files of the server and of its processes, and the
number of files that are left in its temporary folder. At the end the app is stopped, and a verdict
printed. Linux only: it reads /proc.
"""

import argparse
import http.client
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import cv2
import numpy as np

GROWTH = 1.15
"""Largest ratio of the median memory of the last third to that of the middle third."""
ENDED_WITHIN = 10.0
"""Seconds after the end of the server within which its processes must have ended."""
SIZE = (320, 240)
FRAMES = 12


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="nearfar-soak-"))
    served, temporary = folder / "served", folder / "temporary"
    temporary.mkdir()
    write_images(served)
    rows: list[dict[str, Any]] = []
    seen: set[int] = set()
    with started(served, folder / "data", temporary) as soak, asked.out.open("w") as out:
        soak.chance.seed(asked.seed)
        begun = time.monotonic()
        while time.monotonic() - begun < 60 * asked.minutes:
            action = soak.chance.choice(ACTIONS)
            try:
                action(soak)
                soak.done[action.__name__] += 1
            except RefusedError as refused:
                soak.done[f"{action.__name__} refused"] += 1
                print(refused, file=sys.stderr)
            row = measured(soak.pid, temporary) | {"minutes": (time.monotonic() - begun) / 60}
            row |= {"action": action.__name__, "jobs": len(soak.get("/api/jobs"))}
            seen |= set(descendants(soak.pid))
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
    left = surviving(seen)
    files = [each for each in temporary.rglob("*") if each.is_file()]
    incoming = list((folder / "data").rglob(".*incoming*"))
    print(json.dumps(verdict(rows, soak.done, left, len(files) + len(incoming)), indent=1))
    shutil.rmtree(folder)


class RefusedError(Exception):
    """The app refused a request, such as one that took too long on a loaded machine."""


@dataclass
class Soak:
    """A running app, and what was done with it."""

    port: int
    pid: int
    root: str = ""
    done: Counter[str] = field(default_factory=Counter)
    chance: random.Random = field(default_factory=random.Random)

    def ask(self, method: str, path: str, body: bytes | None = None) -> tuple[int, bytes]:
        """Return the status and the body of an answer."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=180)
        kind = {"Content-Type": "application/json"} if body and body[:1] == b"{" else {}
        try:
            connection.request(method, path, body, kind)
            reply = connection.getresponse()
            return reply.status, reply.read()
        finally:
            connection.close()

    def get(self, path: str) -> Any:
        """Return the JSON of an answer."""
        status, body = self.ask("GET", path)
        if status != 200:
            raise RefusedError(path, status, body[:300])
        return json.loads(body)

    def post(self, path: str, content: dict[str, Any] | None = None) -> Any:
        """Send JSON, and return that of the answer."""
        status, body = self.ask("POST", path, json.dumps(content or {}).encode())
        if status not in (200, 201):
            raise RefusedError(path, status, body[:300])
        return json.loads(body)

    def ended(self, job: dict[str, Any], seconds: float = 600.0) -> dict[str, Any]:
        """Wait for the end of a job, at most for some seconds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            now: dict[str, Any] = self.get(f"/api/jobs/{job['id']}")
            if now["status"] not in ("waiting", "running"):
                return now
            time.sleep(0.2)
        return self.get(f"/api/jobs/{job['id']}")  # type: ignore[no-any-return]

    def pair(self) -> dict[str, Any]:
        """Return a request to localize a frame."""
        near = f"{self.root}/frames/{self.chance.randrange(FRAMES)}.png"
        return {"kind": "localize", "far": f"{self.root}/far.png", "near": near}

    def track(self) -> dict[str, Any]:
        """Return a request to follow the frames, or the video."""
        frames = self.chance.choice(["frames", "flight.avi"])
        return {"kind": "track", "far": f"{self.root}/far.png", "frames": f"{self.root}/{frames}"}


def localize(soak: Soak) -> None:
    job = soak.post("/api/jobs", soak.pair() | {"max_effort": "points"})
    if soak.ended(job)["status"] == "done":
        soak.get(f"/api/jobs/{job['id']}/result")
    soak.ask("GET", f"/api/jobs/{job['id']}/export?format=csv&format=geojson")


def cancel(soak: Soak) -> None:
    request = soak.chance.choice([soak.pair, soak.track])()
    job = soak.post("/api/jobs", request)
    soak.ended(job, soak.chance.uniform(0, 8))
    soak.post(f"/api/jobs/{job['id']}/cancel")


def follow(soak: Soak) -> None:
    job = soak.post("/api/jobs", soak.track())
    ended = soak.ended(job)
    if ended["frames"] is None:
        return
    soak.get(f"/api/jobs/{job['id']}/track")
    soak.ask("GET", f"/api/jobs/{job['id']}/track/export?format=csv&format=png")


def go_on(soak: Soak) -> None:
    """Start a job again that was cancelled."""
    jobs = [each for each in soak.get("/api/jobs") if each["status"] == "cancelled"]
    for job in jobs[:1]:
        soak.post(f"/api/jobs/{job['id']}/start")
        soak.ended(job)


def batch(soak: Soak) -> None:
    request = {"far": f"{soak.root}/far.png", "folder": f"{soak.root}/frames"}
    made = soak.post("/api/batches", request | {"max_effort": "points"})
    time.sleep(soak.chance.uniform(0, 10))
    soak.post(f"/api/batches/{made['id']}/cancel")
    soak.ask("GET", f"/api/batches/{made['id']}/export?layout=csv")


def send(soak: Soak) -> None:
    pixels = np.random.default_rng(soak.chance.randrange(5)).integers(0, 255, (200, 300, 3))
    _, png = cv2.imencode(".png", pixels.astype(np.uint8))
    soak.ask("POST", "/api/images?name=a.png", png.tobytes())
    assert soak.ask("POST", "/api/images?name=a.png", png.tobytes()[:500])[0] >= 400


def look(soak: Soak) -> None:
    far, video = quote(f"{soak.root}/far.png"), quote(f"{soak.root}/flight.avi")
    homography = f"&h={1 + soak.chance.random()}&h=0&h=0&h=0&h=1&h=0&h=0&h=0&h=1"
    for path in (
        f"/api/images/picture?ref={far}&thumbnail=true",
        f"/api/images/warped?ref={far}&width=400&height=300{homography}",
        f"/api/tracks/frame?ref={video}&seconds={soak.chance.random()}",
    ):
        soak.ask("GET", path)


def reload(soak: Soak) -> None:
    for path in ("/", "/static/app.css", "/static/js/main.js", "/api/about", "/api/jobs"):
        assert soak.ask("GET", path)[0] == 200


def annotate(soak: Soak) -> None:
    pair = soak.pair()
    made = soak.post("/api/annotations", {"far": pair["far"], "near": pair["near"]})
    soak.ask("DELETE", f"/api/annotations/{made['annotation']['id']}")


def delete(soak: Soak) -> None:
    for job in soak.get("/api/jobs")[5:]:
        soak.ask("DELETE", f"/api/jobs/{job['id']}")


ACTIONS: list[Callable[[Soak], None]] = [
    *(localize, localize, cancel, cancel, cancel, follow, go_on, batch),
    *(send, look, look, reload, reload, annotate, delete),
]


def write_images(served: Path) -> None:
    """Write a far image of blobs of all sizes, and frames of parts of it, also as a video."""
    rng = np.random.default_rng(0)
    far = np.zeros((600, 900, 3), np.float32)
    for cells in (12, 40, 120, 300):
        noise = rng.normal(0, 1, (cells * 2 // 3, cells, 3)).astype(np.float32)
        far += cv2.resize(noise, (900, 600), interpolation=cv2.INTER_CUBIC)
    far = np.clip(128 + 35 * far, 0, 255)
    (served / "frames").mkdir(parents=True)
    cv2.imwrite(str(served / "far.png"), far.astype(np.uint8))
    code = cv2.VideoWriter.fourcc(*"MJPG")
    video = cv2.VideoWriter(str(served / "flight.avi"), code, 10, SIZE)
    for number in range(FRAMES):
        left, top = 150 + 30 * number, 150 + 12 * number
        part = far[top : top + SIZE[1] // 2, left : left + SIZE[0] // 2]
        frame = np.rint(cv2.resize(part, SIZE, interpolation=cv2.INTER_CUBIC)).clip(0, 255)
        cv2.imwrite(str(served / "frames" / f"{number}.png"), frame.astype(np.uint8))
        video.write(frame.astype(np.uint8))
    video.release()


@contextmanager
def started(served: Path, data: Path, temporary: Path) -> Iterator[Soak]:
    """Start the app, and stop it at the end."""
    words = [sys.executable, "-m", "nearfar", "app", str(served), "--port", "0"]
    changed = {"TMPDIR": str(temporary), "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [*words, "--data", str(data)], stdout=subprocess.PIPE, text=True, env=os.environ | changed
    )
    assert process.stdout is not None
    address = process.stdout.readline().removeprefix("nearfar app:").strip()
    soak = Soak(urlsplit(address).port or 0, process.pid)
    soak.root = soak.get("/api/folders")["folders"][0]["ref"]
    try:
        yield soak
    finally:
        process.terminate()
        process.wait(60)
        process.stdout.close()


def descendants(pid: int) -> list[int]:
    """Return the processes that a process has started, and those that they have started."""
    found: list[int] = []
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += [int(each) for each in (task / "children").read_text().split()]
    return found + [each for child in found for each in descendants(child)]


def measured(pid: int, temporary: Path) -> dict[str, Any]:
    """Return memory in megabytes, open files and processes of the app, and temporary files."""
    children = descendants(pid)
    return {
        "server_mb": memory(pid),
        "workers_mb": sum(memory(each) for each in children),
        "processes": len(children),
        "open_files": len(os.listdir(f"/proc/{pid}/fd")),  # noqa: PTH208
        "temporary": sum(each.is_file() for each in temporary.rglob("*")),
    }


def memory(pid: int) -> float:
    """Return the resident memory of a process in megabytes; 0 where it has ended."""
    with suppress(OSError, StopIteration):
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        return int(next(each for each in lines if each.startswith("VmRSS")).split()[1]) / 1024
    return 0.0


def surviving(pids: set[int]) -> list[int]:
    """Return the processes of the app that are left some seconds after its end."""
    end = time.monotonic() + ENDED_WITHIN
    left = sorted(pids)
    while left and time.monotonic() < end:
        left = [each for each in left if memory(each) > 0 and is_of_app(each)]
        time.sleep(0.2)
    return left


def is_of_app(pid: int) -> bool:
    """Return whether a process is the app's, and not a later one of the same number."""
    with suppress(OSError):
        return b"nearfar" in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def verdict(
    rows: list[dict[str, Any]], done: Counter[str], left: list[int], files: int
) -> dict[str, Any]:
    """Return the figures of the middle and the last third, and whether all is well."""
    third = len(rows) // 3
    middle, last = rows[third : 2 * third], rows[2 * third :]
    found: dict[str, Any] = {"minutes": rows[-1]["minutes"], "actions": dict(done)}
    well = not left and not files
    for name in ("server_mb", "workers_mb", "processes", "open_files", "temporary"):
        before, after = (float(np.median([row[name] for row in part])) for part in (middle, last))
        found[name] = [round(before, 1), round(after, 1), max(row[name] for row in rows)]
        well = well and after <= max(GROWTH * before, before + 3)
    return found | {"left_processes": len(left), "left_files": files, "well": well}


if __name__ == "__main__":
    main()
