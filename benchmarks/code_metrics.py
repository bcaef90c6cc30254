"""What source code is like, in numbers: sizes, types, docstrings, shapes of arrays, duplicates.

    python benchmarks/code_metrics.py [SOURCES ...] [--worst 10]

One column a folder of SOURCES. Public is what no part of its name hides with an underscore;
functions within functions are not. `pip install pylint` counts duplicates.
"""

import argparse
import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from statistics import median

SAME_LINES = 6
"""Fewer equal lines, without imports, signatures and docstrings, are no duplicate."""
LONG_FILE, LONG_FUNCTION = 350, 60

_LENGTH = r"(?:\.\.\.|\w+(?: ?[*/+-] ?\w+)*)"
SHAPE_OR_UNIT = re.compile(
    rf"\({_LENGTH}, ?(?:{_LENGTH}, ?)*{_LENGTH}?\)"  # (N, 2), (N,), (..., K, 2)
    r"|\b(?:\d+|[A-Z])x(?:\d+|[A-Z])\b"  # 3x3
    r"|\b(?:pixels?|px|degrees|radians|metres|octaves|RGB)\b|\bunit (?:length|norm|vectors?)\b"
)
"""What a docstring tells an array's shape or unit by."""

Function = ast.FunctionDef | ast.AsyncFunctionDef
Documented = Function | ast.ClassDef | ast.Module


@dataclass(frozen=True)
class Place:
    """Where something stands, and how much of it there is."""

    file: Path
    line: int
    name: str
    lines: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line} {self.name} ({self.lines} lines)"


@dataclass(frozen=True)
class Sources:
    """The modules of a folder."""

    folder: Path

    @cached_property
    def modules(self) -> dict[Path, ast.Module]:
        """Parsed, by their files."""
        return {
            file: ast.parse(file.read_text("utf-8")) for file in sorted(self.folder.rglob("*.py"))
        }

    @cached_property
    def files(self) -> list[Place]:
        """All files."""
        return [
            Place(file, 1, "", len(file.read_text("utf-8").splitlines())) for file in self.modules
        ]

    @cached_property
    def functions(self) -> list[tuple[Place, Function]]:
        """All functions and methods, those within others too."""
        return [
            (place(file, node), node)
            for file, module in self.modules.items()
            for node in ast.walk(module)
            if isinstance(node, Function)
        ]

    @cached_property
    def public(self) -> list[tuple[Place, Documented]]:
        """Modules, classes, functions and methods."""
        found: list[tuple[Place, Documented]] = []
        for file, module in self.modules.items():
            parts = file.relative_to(self.folder).with_suffix("").parts
            if any(hidden(part) and part not in ("__init__", "__main__") for part in parts):
                continue
            found.append((Place(file, 1, "", 0), module))
            found += [(place(file, node), node) for node in members(module)]
        return found

    @cached_property
    def array_types(self) -> dict[str, bool]:
        """Names of array types, and whether the docstring below an alias tells shape or unit."""
        types = {"NDArray": False, "ndarray": False}
        classes = {node.name for _, node in self.public if isinstance(node, ast.ClassDef)}
        for module in self.modules.values():
            for node, below in pairwise([*module.body, ast.Pass()]):
                match node:
                    case ast.Assign(targets=[ast.Name(id=name)], value=value) if (
                        ast.unparse(value).startswith("NDArray[") and name not in classes
                    ):
                        told = SHAPE_OR_UNIT.search(ast.unparse(below))
                        types[name] = isinstance(below, ast.Expr) and told is not None
        return types

    @cached_property
    def taking_arrays(self) -> list[tuple[Place, bool, bool]]:
        """Public functions with arrays among their parameters.

        With each: whether its docstring tells a shape or unit, and whether that, or else the type
        of each array, does.
        """
        types = self.array_types
        found = []
        for where, node in self.public:
            if not isinstance(node, Function):
                continue
            arrays = set[str]().union(*(names_in(each.annotation) for each in parameters(node)))
            arrays &= types.keys()
            if arrays:
                told = bool(SHAPE_OR_UNIT.search(ast.get_docstring(node) or ""))
                found.append((where, told, told or all(types[name] for name in arrays)))
        return found

    @cached_property
    def duplicates(self) -> list[tuple[str, range]]:
        """Lines that stand in another file too, by module."""
        command = [sys.executable, "-m", "pylint", "--disable=all", "--enable=duplicate-code"]
        options = [f"--min-similarity-lines={SAME_LINES}", "--output-format=json"]
        done = subprocess.run(
            [*command, *options, str(self.folder)], capture_output=True, text=True
        )
        if not done.stdout.startswith("["):
            sys.exit(f"no answer of pylint: {done.stderr.strip()}")
        found = [
            part
            for message in json.loads(done.stdout)
            for part in re.findall(r"^==(.+):\[(\d+):(\d+)\]$", message["message"], re.MULTILINE)
        ]
        return [(module, range(int(start) + 1, int(end) + 1)) for module, start, end in found]


def hidden(name: str) -> bool:
    """Whether a name is private or special."""
    return name.startswith("_")


def place(file: Path, node: Function | ast.ClassDef) -> Place:
    """Where a definition stands."""
    return Place(file, node.lineno, node.name, (node.end_lineno or 0) - node.lineno + 1)


def members(owner: ast.Module | ast.ClassDef) -> Iterator[Function | ast.ClassDef]:
    """Public classes and functions of a module, and of its public classes."""
    for node in owner.body:
        if not isinstance(node, Function | ast.ClassDef) or hidden(node.name):
            continue
        if "overload" not in map(ast.unparse, node.decorator_list):
            yield node
        if isinstance(node, ast.ClassDef):
            yield from members(node)


def parameters(function: Function) -> list[ast.arg]:
    """All but `self` and `cls`."""
    named = function.args
    every = [*named.posonlyargs, *named.args, *named.kwonlyargs, named.vararg, named.kwarg]
    return [each for each in every if each is not None and each.arg not in ("self", "cls")]


def names_in(annotation: ast.expr | None) -> set[str]:
    """Names of types that an annotation mentions, quoted ones too."""
    text = "" if annotation is None else ast.unparse(annotation)
    return set(re.findall(r"[A-Za-z_]\w*", text))


def annotated(function: Function) -> bool:
    """Whether all parameters and the result have types."""
    return function.returns is not None and all(each.annotation for each in parameters(function))


def share(count: int, of: int) -> str:
    """As percentage and count."""
    return f"{100 * count / of:.1f} % of {of:,}" if of else "none"


def measures(sources: Sources) -> dict[str, str]:
    """The table's column."""
    files = [each.lines for each in sources.files]
    functions = [where.lines for where, _ in sources.functions]
    public = [node for _, node in sources.public]
    arrays = sources.taking_arrays
    duplicated = {(module, line) for module, lines in sources.duplicates for line in lines}
    return {
        "files": f"{len(files):,}",
        "lines": f"{sum(files):,}",
        "lines a file, median": f"{median(files):.0f}",
        "lines a file, most": f"{max(files)}",
        f"files of more than {LONG_FILE} lines": f"{sum(each > LONG_FILE for each in files)}",
        "functions": f"{len(functions):,}",
        "lines a function, median": f"{median(functions):.0f}",
        "lines a function, most": f"{max(functions)}",
        f"functions of more than {LONG_FUNCTION} lines": (
            f"{sum(each > LONG_FUNCTION for each in functions)}"
        ),
        "functions with all types": share(
            sum(annotated(node) for _, node in sources.functions), len(functions)
        ),
        "public names with a docstring": share(
            sum(ast.get_docstring(node) is not None for node in public), len(public)
        ),
        "public functions of arrays, whose docstring tells shape or unit": share(
            sum(told for _, told, _ in arrays), len(arrays)
        ),
        "the same, or else the type of each array tells it": share(
            sum(told for _, _, told in arrays), len(arrays)
        ),
        f"duplicated lines ({SAME_LINES} or more in a row)": f"{len(duplicated)}",
    }


def print_worst(sources: Sources, count: int) -> None:
    """Name what is largest or lacks something."""
    files = sorted(sources.files, key=lambda each: -each.lines)
    functions = sorted((where for where, _ in sources.functions), key=lambda each: -each.lines)
    undocumented = [where for where, node in sources.public if ast.get_docstring(node) is None]
    untyped = [where for where, node in sources.functions if not annotated(node)]
    shapeless = [where for where, _, told in sources.taking_arrays if not told]
    duplicated = [f"{module}:{lines[0]}-{lines[-1]}" for module, lines in sources.duplicates]
    for title, places in (
        ("largest files", files[:count]),
        ("longest functions", functions[:count]),
        ("without docstring", undocumented),
        ("without types", untyped),
        ("arrays of unknown shape and unit", shapeless),
        ("duplicated", duplicated),
    ):
        print(f"\n{title}:", *(places or ["none"]), sep="\n  ")


def main() -> None:
    """Print the table and what is worst in the first folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sources", type=Path, nargs="*", default=[Path("src/nearfar")])
    parser.add_argument("--worst", type=int, default=0, help="how many files and functions to name")
    arguments = parser.parse_args()
    columns = [Sources(folder) for folder in arguments.sources]
    tables = [measures(each) for each in columns]
    print("|", *(f"| {folder}" for folder in arguments.sources), "|")
    print("|---" * (len(columns) + 1) + "|")
    for name in tables[0]:
        print(f"| {name}", *(f"| {table[name]}" for table in tables), "|")
    if arguments.worst:
        print_worst(columns[0], arguments.worst)


if __name__ == "__main__":
    main()
