"""Localize many small pairs with damaged images among them, killed twice and resumed.

The pairs are close-ups of a photograph of scikit-image. The result file must be as long as the
list, have a reason for each damaged image, and not change when the command runs once more.

Run: python -m benchmarks.batch --pairs 1000 --bad 20
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import skimage.data
from PIL import Image

SIDE, WIDTH, HEIGHT, ENLARGED = 100, 120, 100, 2.5
"""Pixels of the border that is left out, and sides and enlargement of the close-ups."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--bad", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder, out = Path(made), Path(made) / "answers.jsonl"
        bad = make_pairs(folder, asked.pairs, asked.bad, asked.seed)
        command = [sys.executable, "-m", "nearfar", "localize", "--max-effort", "points"]
        command += ["--pairs", str(folder / "pairs.csv"), "--out", str(out)]
        for share in (0.3, 0.7):
            killed(command, out, round(share * asked.pairs))
        resumed = subprocess.run(command, capture_output=True, text=True, check=False)
        content = out.read_bytes()
        print(resumed.stdout, end="", flush=True)
        subprocess.run(command, capture_output=True, check=False)
        rows = [json.loads(line) for line in content.splitlines()]
        wrong = {n for n, row in enumerate(rows) if row["status"] == "error"}
        print(f"exit status: {resumed.returncode}")
        print(f"lines: {len(rows)}; {dict(Counter(row['status'] for row in rows))}")
        print(f"reasons for the damaged images alone: {wrong == bad}")
        print(f"unchanged by one more run: {out.read_bytes() == content}")
        whole = folder / "whole.jsonl"
        subprocess.run([*command[:-1], str(whole)], capture_output=True, check=False)
        print(f"same bytes as without a kill: {whole.read_bytes() == content}")


def make_pairs(folder: Path, count: int, bad: int, seed: int) -> set[int]:
    """Write a far image, close-ups and their list; return the numbers of the damaged ones."""
    rng = np.random.default_rng(seed)
    pixels = skimage.data.astronaut()
    Image.fromarray(pixels).save(folder / "far.png")
    damaged = set(rng.choice(count, bad, replace=False).tolist())
    lines = ["far,near"]
    for number in range(count):
        x = int(rng.integers(SIDE, pixels.shape[1] - SIDE - WIDTH))
        y = int(rng.integers(0, pixels.shape[0] - 2 * SIDE - HEIGHT))
        part = np.ascontiguousarray(pixels[y : y + HEIGHT, x : x + WIDTH])
        near = cv2.resize(part, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
        file = folder / f"{number:05}.png"
        Image.fromarray(np.asarray(near)).save(file)
        if number in damaged:
            file.write_bytes(file.read_bytes()[:500])
        lines.append(f"far.png,{file.name}")
    (folder / "pairs.csv").write_text("\n".join(lines) + "\n")
    return damaged


def killed(command: list[str], out: Path, lines: int) -> None:
    """Run a command, and kill it when its result file has a number of lines."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        while not out.exists() or out.read_bytes().count(b"\n") < lines:
            if running.poll() is not None:
                raise SystemExit(f"the batch ended with {running.returncode} before it was killed")
            time.sleep(0.05)
        running.kill()
    done = out.read_bytes().count(b"\n")
    print(f"killed after {done} lines", flush=True)


if __name__ == "__main__":
    main()
