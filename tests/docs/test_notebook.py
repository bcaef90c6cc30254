"""The notebook runs from a clean kernel, and what is stored in it may be published."""

import json
import platform
import re
from pathlib import Path
from typing import Any

import pytest

STORY = Path(__file__).parents[2] / "docs" / "notebooks" / "story.ipynb"
PHOTOGRAPHS = '("astronaut.png", "chelsea.png", "coffee.png")'
"""Photographs of the benchmark, in the cell that runs it."""
MOST_BYTES = 1_500_000
ABSOLUTE_PATH = re.compile(r"""(?:^|[\s"'(=])(?:/[\w.-]+/[\w./-]+|[A-Za-z]:\\)""", re.MULTILINE)

Cell = dict[str, Any]


def code_cells(notebook: Any) -> list[Cell]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def kinds(notebook: Any) -> list[list[list[str]]]:
    """The MIME types of what each cell shows; "stdout" or "stderr" for what it prints."""
    return [
        [sorted(shown.get("data", [shown.get("name", "error")])) for shown in cell["outputs"]]
        for cell in code_cells(notebook)
    ]


def texts(shown: Cell) -> list[str]:
    """What an output says in words."""
    data = shown.get("data", {})
    words = [text for kind, text in data.items() if kind.startswith("text/")]
    return ["".join(text) for text in (*words, shown.get("text", ""))]


@pytest.fixture(scope="module")
def stored() -> Any:
    return json.loads(STORY.read_text(encoding="utf-8"))


def test_stored_outputs_are_whole_and_name_no_machine(stored: Any) -> None:
    assert STORY.stat().st_size < MOST_BYTES
    cells = code_cells(stored)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [shown for cell in cells for shown in cell["outputs"]]
    assert {shown["output_type"] for shown in outputs} == {"execute_result", "stream"}
    assert all(shown.get("name") != "stderr" for shown in outputs)
    for text in (text for shown in outputs for text in texts(shown)):
        assert not ABSOLUTE_PATH.search(text), text
        assert platform.node() not in text, text


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("saved /home/someone/a.png", True),
        ("'/tmp/x/y'", True),
        (r"C:\Users", True),
        ("mean / median, 3/4, near/far, a/b.png", False),
    ],
)
def test_absolute_paths_are_told_from_other_text(text: str, found: bool) -> None:
    assert bool(ABSOLUTE_PATH.search(text)) == found


@pytest.mark.timeout(900)
def test_it_runs_from_a_clean_kernel(
    stored: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one of the three photographs of its benchmark, which is what takes its time."""
    for package in ("ipykernel", "lancedb", "matplotlib", "scipy", "skimage"):
        pytest.importorskip(package)
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    notebook = nbformat.reads(STORY.read_text(encoding="utf-8"), as_version=4)
    (benchmark,) = [cell for cell in code_cells(notebook) if PHOTOGRAPHS in cell["source"]]
    benchmark["source"] = benchmark["source"].replace(PHOTOGRAPHS, '("coffee.png",)')
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=400, resources=resources).execute()
    assert kinds(notebook) == kinds(stored)
