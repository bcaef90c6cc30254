"""Run the figures of the README again, and say which moved.

    python benchmarks/headline.py PAIRS OUT [--kitti KITTI] [--photographs PHOTOS] [--jobs 2]
        [--method adaptive --method sift-tuned]

The README's table is read from the file itself. Correct answers are counted as it says, without
rejecting any. KITTI takes 200 pairs of each method, so figures of the README for all 1,954 are
compared as shares. With --photographs the scale curve gives S50, which has moved where it left the
README's interval. Runs are resumed. The exit status is 1 where a figure is lower.
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nearfar.bench.results import Result, load_benchmarks
from nearfar.bench.studies.curves import half_success, outcomes

README = Path(__file__).parent.parent / "README.md"
EVERY_MODEL = ["--max-false-alarms", "inf", "--min-confidence", "0"]
ROWS = {
    "zooms and viewpoints": ("homogr", "oxford"),
    "kite photographs": ("copr",),
    "extreme views": ("evd",),
    "scenes with depth": ("kusvod2", "wxbs"),
}
"""Groups of pairs by the beginning of a row of the README's table."""
KITTI, SAMPLE = "KITTI Odometry", 200
TOLERATED = 0.02
"""Difference of shares that counts as unmoved where the cases are not the same."""
CURVE = ["--mode", "scale", "--sets", "homogr", "--sets", "oxford"]
"""The cases of the scale curve: 231 of the pairs with planes."""


@dataclass(frozen=True)
class Figure:
    """A figure of the README and the one measured now, as text.

    Attributes:
        name: what is measured.
        method: of the column.
        said: in the README.
        now: measured.
        moved: "lower", "higher" or nothing.
    """

    name: str
    method: str
    said: str
    now: str
    moved: str


def counted(name: str, method: str, said: tuple[int, int], results: Sequence[Result]) -> Figure:
    """Compare correct cases; as shares where the README has another number of cases."""
    right, count = sum(each.strict for each in results), len(results)
    away = right / max(1, count) - said[0] / said[1]
    limit = 0.0 if count == said[1] else TOLERATED
    moved = "lower" if away < -limit - 1e-9 else "higher" if away > limit + 1e-9 else ""
    return Figure(name, method, f"{said[0]} of {said[1]}", f"{right} of {count}", moved)


def said(text: str) -> dict[tuple[str, str], tuple[int, int]]:
    """Return the README's correct and all cases, by the beginning of the row and the method."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    first = next(number for number, line in enumerate(lines) if "| cases |" in line)
    columns = [cell.strip(" `") for cell in lines[first].strip("|").split("|")]
    found = {}
    for line in lines[first + 2 :]:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        name = next((each for each in (*ROWS, KITTI) if cells[0].startswith(each)), None)
        if name is None:
            break
        for method, cell in zip(columns[2:], cells[2:], strict=True):
            number = re.fullmatch(r"(\d+)(?: of (\d+))?", cell)
            if number:
                found[name, method] = int(number[1]), int(number[2] or cells[1])
    return found


def said_half(text: str) -> dict[str, tuple[float, float, float]]:
    """Return the README's S50 and its interval by method."""
    header, _, row = text[text.index("S50 is the scale change") :].split("\n\n")[1].splitlines()
    methods = [cell.strip(" `") for cell in header.strip("|").split("|")]
    found = {}
    for method, cell in zip(methods, row.strip("|").split("|"), strict=True):
        value, low, high = map(float, re.findall(r"[\d.]+", cell))
        found[method] = value, low, high
    return found


def nearfar(*arguments: object) -> None:
    """Run a command of nearfar; failed pairs are no failure here."""
    subprocess.run([sys.executable, "-m", "nearfar", *map(str, arguments)], check=True)


def figures(asked: argparse.Namespace) -> Iterator[Figure]:
    """Run the benchmarks, and yield the figures."""
    text = README.read_text(encoding="utf-8")
    known, half = said(text), said_half(text)
    methods = [word for method in asked.method for word in ("--method", method)]
    shared = ["--out", asked.out, *methods, "--jobs", asked.jobs, *EVERY_MODEL]
    nearfar("bench", "pairs", asked.pairs, *shared)
    if asked.kitti:
        nearfar("bench", "kitti", asked.kitti, "--sample", SAMPLE, *shared)
    if asked.photographs:
        scenes = ["--pairs", asked.pairs, "--backgrounds", asked.photographs, *CURVE]
        nearfar("bench", "scale-curve", *scenes, *shared)
    results = {each.name: each.results for each in load_benchmarks([asked.out])}
    for method in asked.method:
        own = [each for each in results["pairs"] if each.row["method"] == method]
        for name, groups in ROWS.items():
            chosen = [each for each in own if each.group in groups]
            yield counted(name, method, known[name, method], chosen)
        if asked.kitti:
            own = [each for each in results["kitti"] if each.row["method"] == method]
            yield counted(KITTI, method, known[KITTI, method], own)
        if asked.photographs:
            own = [each for each in results["scale_curve"] if each.row["method"] == method]
            value, (least, low, high) = half_success(outcomes(own), 0, 0).value, half[method]
            moved = "lower" if value < low else "higher" if value > high else ""
            yield Figure("S50", method, f"{least} ({low} to {high})", f"{value:.1f}", moved)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pairs", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--kitti", type=Path, help="folder of KITTI Odometry")
    parser.add_argument("--photographs", type=Path, help="backgrounds of the scale curve")
    parser.add_argument("--method", action="append", help="default: sift, sift-tuned, adaptive")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    asked.method = asked.method or ["sift", "sift-tuned", "adaptive"]
    found = list(figures(asked))
    print("\n| | method | README | now | |\n|---|---|---|---|---|")
    for each in found:
        print(f"| {each.name} | `{each.method}` | {each.said} | {each.now} | {each.moved} |")
    sys.exit(any(each.moved == "lower" for each in found))


if __name__ == "__main__":
    main()
