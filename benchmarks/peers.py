"""CPU seconds and peak memory of whole commands: the methods beside learned matchers.

Run with `python -m benchmarks.peers PAIRS OUT.jsonl [METHOD ...]`. PAIRS is a folder of pairs with
a pair.json. Each command runs in a process of its own with one thread. Rows are kept in OUT.jsonl,
and a run that was stopped goes on.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

REFERENCE = "sift-tuned"
METHODS: dict[str, list[str]] = {
    "sift-tuned": ["--method", "sift-tuned"],
    "xfeat-lighterglue": ["--method", "xfeat-lighterglue"],
    "aliked-lightglue": ["--method", "aliked-lightglue"],
    "adaptive": [],
    "adaptive, xfeat-lighterglue": ["--matcher", "xfeat-lighterglue"],
    "adaptive, aliked-lightglue": ["--matcher", "aliked-lightglue"],
}


def measured(pair: Path, options: list[str]) -> dict[str, float]:
    """Return CPU seconds and peak memory in megabytes of one command."""
    known = json.loads((pair / "pair.json").read_text())
    command = ["nearfar", "localize", str(pair / known["far"]), str(pair / known["near"])]
    model = ["--model", known["model"]]
    code = (
        "import json, resource, subprocess, sys\n"
        "subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(json.dumps([used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))\n"
    )
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", code, *command, *model, *options],
        env=environment,
        stdout=subprocess.PIPE,
        check=True,
    )
    seconds, megabytes = json.loads(run.stdout)
    return {"cpu_seconds": seconds, "megabytes": megabytes}


def main() -> None:
    """Measure what is missing, and print the table."""
    folder, out, methods = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:] or list(METHODS)
    rows = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    done = {(row["pair"], row["method"]) for row in rows}
    for file in sorted(folder.rglob("pair.json")):
        name = str(file.parent.relative_to(folder))
        for method in methods:
            if (name, method) in done:
                continue
            row = {"pair": name, "method": method, **measured(file.parent, METHODS[method])}
            rows.append(row)
            with out.open("a") as lines:
                lines.write(json.dumps(row) + "\n")
    columns = f"CPU seconds, median | most | over {REFERENCE}, median | megabytes, most"
    print(f"| method | pairs | {columns} |")
    print("|---|---|---|---|---|---|")
    usual = {row["pair"]: row["cpu_seconds"] for row in rows if row["method"] == REFERENCE}
    for method in methods:
        own = [row for row in rows if row["method"] == method]
        seconds = [row["cpu_seconds"] for row in own]
        memory = max(row["megabytes"] for row in own)
        ratios = [row["cpu_seconds"] / usual[row["pair"]] for row in own if row["pair"] in usual]
        ratio = f"{median(ratios):.2f}" if ratios else ""
        times = f"{median(seconds):.1f} | {max(seconds):.1f} | {ratio}"
        print(f"| `{method}` | {len(own)} | {times} | {memory:.0f} |")


if __name__ == "__main__":
    main()
