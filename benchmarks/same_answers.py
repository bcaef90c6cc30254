"""Record what one version of nearfar answers, and compare the answers of two versions.

    python benchmarks/same_answers.py run SOURCE DATA OUT
    python benchmarks/same_answers.py compare OUT_A OUT_B [--ignore KEY]

SOURCE is a Python interpreter that has nearfar, or the folder of a source tree. DATA has `pairs/`,
`kitti/` and `cases/`. `run` uses one thread, appends one row per item to OUT/answers.jsonl and
skips the items that are there; it prints an error instead of a row. `compare` prints every
difference except in times and versions; its exit status is 0 where there is none.
"""

import argparse
import functools
import hashlib
import json
import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import h5py
from PIL import Image

RENAMED = {"log10_false_alarms": "log10_nfa"}
"""Keys of JSON objects that have a new name: old -> new."""
IGNORED = {"nearfar", "seconds", "modified"}
"""Keys of JSON objects that are not compared: the version, and times of work and of files."""

METHODS: dict[str, dict[str, Any]] = {
    **{name: {} for name in ("adaptive", "sift", "sift-ratio", "sift-tuned", "akaze", "orb")},
    **{name: {"max_size": 600} for name in ("paper", "objects")},
    "paper hog": {"descriptor": "hog", "max_size": 600},
    "asift": {"max_size": 320},
}
"""Settings of the methods that need no weights file; smaller images bound the time of slow ones."""
FUNDAMENTAL = METHODS | {"adaptive": {"max_effort": "zoom"}}
"""Settings for fundamental matrices; a failure with all simulated views takes half a minute."""

PAIRS, KITTI_PAIRS, LARGEST_J = 40, 60, 10
MAP_PAIR_IMAGES, MAP_FRAMES, QUERIES, POSE_QUERIES = 37, 22, 13, 6
"""A GeoTIFF makes them 60 images of a map, and a part of it 20 queries."""
GEOTIFF, PART = "cases/drone-on-satellite/tile.tif", (500, 400, 900, 700)
"""A georeferenced image, and the part of it that is localized: left, top, right, bottom."""
ANY = "colmap csv hloc opencv-yaml"
EXPORTS = {
    "homography": ("pairs/oxford/graf_1_3", f"{ANY} geojson png svg", []),
    "fundamental": ("pairs/kusvod2/box", f"{ANY} png svg", ["--model", "fundamental"]),
    "landmarks": ("pairs/oxford/boat_1_3", "csv svg", ["--method", "paper", "--max-size", "600"]),
    "pose": ("kitti", f"{ANY} kitti png svg tum", []),
    "failed": ("pairs/wxbs/WGSBS_lab", ANY, ["--method", "sift"]),
    "geotiff": (GEOTIFF, "csv geojson", []),
}
"""What is exported: the pair, formats and options of `nearfar localize`."""


def spread(files: Sequence[Path], count: int) -> list[Path]:
    """Return `count` of the files, evenly spread."""
    return [files[index * len(files) // count] for index in range(count)]


def read_pair(file: Path) -> tuple[Path, Path, str]:
    """Return the far image, the near image and the model of a `pair.json`."""
    pair = json.loads(file.read_text(encoding="utf-8"))
    far, near = (Path(os.path.normpath(file.parent / pair[name])) for name in ("far", "near"))
    return far, near, pair["model"]


def frames(data: Path, sequence: str) -> list[Path]:
    """Return the frames of a KITTI sequence."""
    return sorted((data / "kitti/sequences" / sequence / "image_0").glob("*.png"))


@functools.lru_cache(maxsize=1)
def localizer(**settings: Any) -> Any:
    """Return a `Localizer`; only the last one is kept, with its features."""
    import nearfar

    return nearfar.Localizer(**settings)


def localized(name: str, settings: Mapping[str, Any], *images: Path, **options: Any) -> Any:
    """Return the localization of a far and a near image as a JSON object."""
    method = localizer(method=name.split()[0], **settings)
    return method.localize(*images, **options).to_dict()


def nearfar_command(*arguments: str | Path) -> dict[str, Any]:
    """Run a command; return its exit status and the JSON objects that it printed."""
    command = [sys.executable, "-m", "nearfar", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"exit status {done.returncode}: {done.stderr.strip()}")
    lines = done.stdout.splitlines() if "--json" in arguments else []
    return {"status": done.returncode, "printed": [json.loads(line) for line in lines]}


def named_source(poses: Path) -> str:
    """Return the value of `--poses` for a KITTI list, which version 0.1.0 took without a name."""
    import nearfar.maps.map

    return f"kitti={poses}" if hasattr(nearfar.maps.map.Map, "attach") else str(poses)


def part_of_geotiff(data: Path, out: Path) -> Path:
    """Return a file with a part of the GeoTIFF at twice its size, without its coordinates."""
    with Image.open(data / GEOTIFF) as image:
        part = image.convert("RGB").crop(PART)
    part.resize((2 * part.width, 2 * part.height)).save(out / "part.png")
    return out / "part.png"


def map_answers(data: Path, out: Path) -> Any:
    """Return what is in a map, and its answers to queries without and with intrinsics."""
    for name in ("map", "images"):
        shutil.rmtree(out / name, ignore_errors=True)
    (out / "images").mkdir()

    def copied(file: Path) -> Path:  # Names in the map then do not depend on OUT.
        return Path(shutil.copy2(file, out / "images" / "-".join(file.relative_to(data).parts)))

    pairs = [read_pair(file) for file in sorted((data / "pairs").rglob("pair.json"))]
    chosen = spread(sorted({far for far, _, _ in pairs}), MAP_PAIR_IMAGES)
    sequence = frames(data, "03")
    posed = spread(sequence, MAP_FRAMES)
    poses = (data / "kitti/poses/03.txt").read_text(encoding="utf-8").splitlines()
    lines = "".join(poses[int(frame.stem)] + "\n" for frame in posed)
    (out / "poses.txt").write_text(lines, encoding="utf-8")
    queries = [*spread([near for _, near, _ in pairs], QUERIES), part_of_geotiff(data, out)]
    unposed = spread([frame for frame in sequence if frame not in posed], POSE_QUERIES)

    images, folder = map(copied, [*chosen, data / GEOTIFF]), out / "map"
    camera = ["--intrinsics", str(posed[0].parents[1] / "calib.txt")]
    world = ["--poses", named_source(out / "poses.txt"), *camera]
    nearfar_command("map", "build", *images, "--out", folder, "--max-size", "1000")
    nearfar_command("map", "add", folder, *map(copied, posed), *world)
    return {
        "info": nearfar_command("map", "info", folder, "--json"),
        "located": nearfar_command("map", "locate", folder, *queries, "--json"),
        "posed": nearfar_command("map", "locate", folder, *unposed, "--json", *camera),
    }


def exported(data: Path, out: Path, name: str) -> Any:
    """Return what the files of one localization hold."""
    source, formats, given = EXPORTS[name]
    options = [*given, *(f"--export={each}" for each in formats.split())]
    if source == "kitti":
        far, near = frames(data, "03")[20:24:3]
        options.append(f"--intrinsics={far.parents[1] / 'calib.txt'}")
    elif source == GEOTIFF:
        far, near = data / GEOTIFF, part_of_geotiff(data, out)
    else:
        far, near, _ = read_pair(data / source / "pair.json")
    folder = out / "exports" / name
    shutil.rmtree(folder, ignore_errors=True)
    status = nearfar_command("localize", far, near, "--save", folder, *options)["status"]
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {"status": status} | {str(file.relative_to(folder)): content(file) for file in files}


def content(file: Path) -> Any:
    """Return the content of an exported file without times and versions, mostly as hashes."""
    match file.suffix:
        case ".json" | ".geojson":
            return json.loads(file.read_text(encoding="utf-8"))
        case ".png":
            with Image.open(file) as image:
                return [*image.size, image.mode, hashed(image.tobytes())]
        case ".h5":
            with h5py.File(file) as opened:
                names: list[str] = []
                opened.visit(names.append)
                sets = [opened[name] for name in names if isinstance(opened[name], h5py.Dataset)]
                return {each.name: hashed(f"{each.dtype} {each[()].tolist()}") for each in sets}
        case ".db":
            with closing(sqlite3.connect(file)) as database:
                rows = [line.partition(" VALUES(") for line in database.iterdump()]
            tables: dict[str, str] = {}
            for table, _, values in rows:
                tables[table] = tables.get(table, "") + values
            return {table: hashed(values) for table, values in tables.items() if values}
    lines = file.read_bytes().splitlines(keepends=True)
    return hashed(b"".join(line for line in lines if b"atplotlib" not in line))  # Its version.


def hashed(data: bytes | str) -> str:
    """Return the SHA-256 of bytes or text."""
    return hashlib.sha256(data if isinstance(data, bytes) else data.encode()).hexdigest()


def read_answers(out: Path) -> dict[str, Any]:
    """Return the answers of a run by their items."""
    file = out / "answers.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return {row["item"]: row["answer"] for row in map(json.loads, lines)}


def items(data: Path, out: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield the name of each item and a function that returns its answer."""
    for model, methods in {"homography": METHODS, "fundamental": FUNDAMENTAL}.items():
        for name, settings in methods.items():
            for file in spread(sorted((data / "pairs").rglob("pair.json")), PAIRS):
                *images, true_model = read_pair(file)
                asked = functools.partial(localized, name, settings, *images, model=model)
                if model in ("homography", true_model):
                    yield f"pairs {model} {name} {file.parent.relative_to(data / 'pairs')}", asked
    for name in ("sift-tuned", "adaptive"):
        for index in range(KITTI_PAIRS):
            sequence, j = ("00", "03")[index // LARGEST_J % 2], index % LARGEST_J + 1
            found = frames(data, sequence)
            first = index * (len(found) - LARGEST_J) // KITTI_PAIRS
            far, near, camera = found[first], found[first + j], found[0].parents[1] / "calib.txt"
            asked = functools.partial(localized, name, {}, far, near, intrinsics=camera)
            yield f"kitti {name} {sequence}/{far.stem}-{near.stem}", asked
    yield "map", functools.partial(map_answers, data, out)
    for name in EXPORTS:
        yield f"export {name}", functools.partial(exported, data, out, name)


def record(data: Path, out: Path) -> int:
    """Append the answers that are missing; return the exit status."""
    import nearfar

    out.mkdir(parents=True, exist_ok=True)
    version, known = f"{nearfar.__version__} {nearfar.__file__}\n", out / "version.txt"
    if known.exists() and known.read_text(encoding="utf-8") != version:
        raise SystemExit(f"{out} has answers of another version: choose another folder")
    known.write_text(version, encoding="utf-8")
    done, errors = read_answers(out), 0
    with (out / "answers.jsonl").open("a", encoding="utf-8") as file:
        for item, make in items(data, out):
            if item in done:
                continue
            try:
                text = json.dumps({"item": item, "answer": make()})
            except Exception as error:
                errors += 1
                print(f"{item}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
            else:
                file.write(text.replace(str(data), "DATA").replace(str(out), "OUT") + "\n")
                file.flush()
                print(item, flush=True)
    return int(errors > 0)


def run(source: Path, data: Path, out: Path) -> int:
    """Record the answers of one version in a process of its own; return its exit status."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment |= {"OMP_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1", "PYTHONSAFEPATH": "1"}
    interpreter = str(source)
    if source.is_dir():
        interpreter, environment["PYTHONPATH"] = sys.executable, str(source / "src")
        if not (source / "src/nearfar").is_dir():
            raise SystemExit(f"{source} has no src/nearfar: give the folder of a source tree")
    command = [interpreter, __file__, "record", str(data), str(out)]
    return subprocess.run(command, env=environment, check=False).returncode


def differences(old: Any, new: Any, ignored: set[str], where: str) -> Iterator[str]:
    """Yield a line for each difference between two values from JSON."""
    if isinstance(old, dict) and isinstance(new, dict):
        old, new = ({RENAMED.get(key, key): side[key] for key in side} for side in (old, new))
        for key in sorted((old.keys() | new.keys()) - ignored):
            if key in old and key in new:
                yield from differences(old[key], new[key], ignored, f"{where}: {key}")
            else:
                yield f"{where}: {key}: only in {'A' if key in old else 'B'}"
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, ignored, f"{where}: {index}")
    elif json.dumps(old) != json.dumps(new):
        yield f"{where}: {json.dumps(old)} in A, {json.dumps(new)} in B"


def compare(first: Path, second: Path, ignore: Sequence[str]) -> int:
    """Print every difference; return the exit status."""
    old, new = read_answers(first), read_answers(second)
    lines = list(differences(old, new, IGNORED.union(ignore), ""))
    for line in lines:
        print(line.removeprefix(": "))
    print(f"{len(old)} items in A, {len(new)} in B: {len(lines)} differences")
    return int(bool(lines) or not old)


def main() -> int:
    """Parse the command line and run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    actions: dict[str, Callable[..., int]] = {"run": run, "record": record, "compare": compare}
    paths = {"run": "source data out", "record": "data out", "compare": "first second"}
    for name in actions:
        command = commands.add_parser(name)
        for path in paths[name].split():
            command.add_argument(path, type=lambda text: Path(text).absolute())
    command.add_argument("--ignore", action="append", default=[], help="key not to compare")
    asked = vars(parser.parse_args())
    return actions[asked.pop("command")](**asked)


if __name__ == "__main__":
    raise SystemExit(main())
