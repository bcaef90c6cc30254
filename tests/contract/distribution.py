"""Other packages with plug-ins, and the command line that sees them."""

import json
import subprocess
from pathlib import Path

from tests import processes


def write_modules(folder: Path, modules: dict[str, str]) -> Path:
    """A folder for PYTHONPATH with modules by name."""
    folder.mkdir(exist_ok=True)
    for name, source in modules.items():
        (folder / f"{name}.py").write_text(source)
    return folder


def write_entry_points(folder: Path, name: str, modules: list[str]) -> Path:
    """Make a folder of modules a distribution whose entry points are its modules."""
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    points = "".join(f"{module} = {module}\n" for module in modules)
    (about / "entry_points.txt").write_text(f"[nearfar.plugins]\n{points}")
    return folder


def nearfar(package: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command line with a folder on PYTHONPATH."""
    return processes.run([*map(str, arguments)], package)


def write_two_pairs(folder: Path, far: Path, near: Path) -> Path:
    """A folder with the pairs a and b, both of the same images."""
    points = [[100, 100], [400, 100], [400, 400], [100, 400]]
    content = {"far": str(far), "near": str(near), "model": "homography"}
    for name in ("a", "b"):
        (folder / name).mkdir(parents=True)
        pair = {**content, "far_points": points, "near_points": points}
        (folder / name / "pair.json").write_text(json.dumps(pair))
    return folder
