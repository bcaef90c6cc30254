"""Count how many small faults in the code the tests see.

    pip install coverage
    python benchmarks/mutants.py geometry verification features estimators --count 60

One mutant at a time: an operator, a comparison or a number in a room of `src/nearfar` is changed,
and the tests that run the changed line are run until one fails. The tests of the named rooms and
of the folders of --also are considered. Everything happens in a temporary copy.
"""

import argparse
import ast
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree as ET

REPOSITORY = Path(__file__).parent.parent
OPTIONS = ["-q", "-x", "-n0", "-p", "no:cacheprovider"]
TIMEOUT = 240.0
"""Seconds after which a mutant whose tests do not end counts as seen."""

COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Pow: ast.Mult,
}


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        file: relative to the repository.
        line: where the change is.
        before: the expression.
        after: what takes its place.
        source: the file with the change.
    """

    file: Path
    line: int
    before: str
    after: str
    source: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}  {self.before}  ->  {self.after}"


@dataclass(frozen=True)
class Copy:
    """A copy of the repository, in which the tests ran once.

    Attributes:
        folder: the copy.
        tests: the folders of tests.
    """

    folder: Path
    tests: list[str]

    def status(self, *words: str, limit: float | None = None) -> int:
        """Return the exit status of Python in the copy; 1 if it takes more than `limit` seconds."""
        environment = os.environ | {"PYTHONPATH": str(self.folder / "src"), "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                [sys.executable, *words],
                cwd=self.folder,
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=limit,
            )
        except subprocess.TimeoutExpired:
            return 1
        return done.returncode

    def measure(self) -> None:
        """Run all tests once, and note which lines each of them runs."""
        (self.folder / ".coveragerc").write_text(
            "[run]\ndynamic_context = test_function\nsource = src/nearfar\nrelative_files = true\n"
        )
        pytest = ["-m", "pytest", *OPTIONS, "--junitxml=tests.xml", *self.tests]
        if self.status("-m", "coverage", "run", *pytest):
            sys.exit(f"the tests fail without a mutant: run pytest {' '.join(self.tests)}")

    @cached_property
    def seconds(self) -> dict[str, float]:
        """Seconds of each test function, by its dotted name."""
        found: dict[str, float] = {}
        for case in ET.parse(self.folder / "tests.xml").iter("testcase"):  # noqa: S314
            name = f"{case.get('classname')}.{(case.get('name') or '').partition('[')[0]}"
            found[name] = found.get(name, 0.0) + float(case.get("time") or 0)
        return found

    def tests_of(self, mutant: Mutant) -> list[str]:
        """Return the tests that run the changed line, the quickest first.

        A line that is run only while modules are imported, such as a constant, is seen by all
        tests that run anything in its file.
        All tests of the room follow: contexts miss some tests that hypothesis runs.
        """
        contexts = self._contexts(mutant.file, mutant.line) or self._contexts(mutant.file, None)
        known = sorted(contexts & self.seconds.keys(), key=lambda each: self.seconds[each])
        tests = [
            f"{name.rpartition('.')[0].replace('.', '/')}.py::{name.rpartition('.')[2]}"
            for name in known
        ]
        return [*tests, f"tests/{mutant.file.parts[2]}"]

    def _contexts(self, file: Path, line: int | None) -> set[str]:
        from coverage.numbits import numbits_to_nums

        with sqlite3.connect(self.folder / ".coverage") as data:
            rows = data.execute(
                "SELECT context.context, line_bits.numbits FROM line_bits "
                "JOIN file ON file.id = line_bits.file_id "
                "JOIN context ON context.id = line_bits.context_id WHERE file.path = ?",
                (str(file),),
            )
            return {
                context
                for context, bits in rows
                if context and (line is None or line in numbits_to_nums(bits))
            }

    def sees(self, mutant: Mutant) -> bool:
        """Return whether a test fails with the mutant."""
        tests = self.tests_of(mutant)
        file = self.folder / mutant.file
        before = file.read_text("utf-8")
        file.write_text(mutant.source, "utf-8")
        try:
            return self.status("-m", "pytest", *OPTIONS, *tests, limit=TIMEOUT) != 0
        finally:
            file.write_text(before, "utf-8")


def changed(node: ast.AST) -> ast.AST | None:
    """Return what takes the place of an expression, if anything."""
    match node:
        case ast.Compare(left, [operator, *others], comparators) if type(operator) in COMPARISONS:
            return ast.Compare(left, [COMPARISONS[type(operator)](), *others], comparators)
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS:
            return ast.BinOp(left, OPERATORS[type(operator)](), right)
        case ast.Constant(int() | float() as value) if not isinstance(value, bool):
            return ast.Constant(value * 2 if value else 1)
        case ast.UnaryOp(ast.USub() | ast.Not() | ast.Invert(), operand):
            return operand
        case ast.BoolOp(operator, values):
            return ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
    return None


class _Replace(ast.NodeTransformer):
    """Replaces one node."""

    def __init__(self, node: ast.AST, by: ast.AST) -> None:
        self._node, self._by = node, by

    def visit(self, node: ast.AST) -> ast.AST:
        return self._by if node is self._node else self.generic_visit(node)


def mutants(file: Path, relative: Path) -> Iterator[Mutant]:
    """Return all mutants of a file; annotations and types are left as they are."""
    source = file.read_text("utf-8")
    for index, node in enumerate(ast.walk(ast.parse(source))):
        if changed(node) is None:
            continue
        tree = ast.parse(source)
        annotations = {
            id(part)
            for owner in ast.walk(tree)
            for name in ("annotation", "returns")
            if isinstance(given := getattr(owner, name, None), ast.AST)
            for part in ast.walk(given)
        }
        own = list(ast.walk(tree))[index]
        by = changed(own)
        if by is None or id(own) in annotations or not isinstance(own, ast.expr):
            continue
        before, after = ast.unparse(own), ast.unparse(by)
        mutated = ast.fix_missing_locations(_Replace(own, by).visit(tree))
        yield Mutant(relative, own.lineno, before, after, ast.unparse(mutated))


def main() -> None:
    """Print each mutant that no test sees, and the score."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="+", help="packages of src/nearfar")
    parser.add_argument("--also", nargs="*", default=["methods/adaptive", "landmarks"])
    parser.add_argument("--count", type=int, default=60, help="how many mutants are drawn")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    sources = [
        file
        for room in arguments.rooms
        for file in sorted((REPOSITORY / "src/nearfar" / room).rglob("*.py"))
    ]
    every = [mutant for file in sources for mutant in mutants(file, file.relative_to(REPOSITORY))]
    drawn = random.Random(arguments.seed).sample(every, min(arguments.count, len(every)))  # noqa: S311
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder), [f"tests/{each}" for each in (*arguments.rooms, *arguments.also)])
        for name in ("src", "tests", "pyproject.toml"):
            given, into = REPOSITORY / name, copy.folder / name
            (shutil.copytree if given.is_dir() else shutil.copy)(given, into)
        copy.measure()
        seen = 0
        for mutant in drawn:
            start = time.monotonic()
            found = copy.sees(mutant)
            seen += found
            print("seen " if found else "MISSED", f"{time.monotonic() - start:4.0f} s", mutant)
            sys.stdout.flush()
    print(f"{seen} of {len(drawn)} mutants seen, {100 * seen / len(drawn):.0f} %")


if __name__ == "__main__":
    main()
