"""The report: its figures are those of the rows, and its page needs nothing but itself."""

import csv
import itertools
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.report import plots
from nearfar.bench.report.gallery import chosen
from nearfar.bench.report.page import write_report
from nearfar.bench.results import Result, load_benchmarks, load_record
from nearfar.bench.runner import run
from nearfar.bench.summary import Share, by_group, group_number, summarize
from nearfar.errors import BenchmarkError
from nearfar.settings import Settings
from tests.bench.test_run import write_pair
from tests.conftest import KnownPair

EVIL = "<script>alert('case')</script>"


class Page(HTMLParser):
    """What a test asks of a page: references, text of table cells, scripts, pictures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.cells: list[str] = []
        self.scripts = 0
        self.outlines = 0
        self._in_cell = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "data")]
        self.scripts += tag == "script"
        self.outlines += ("class", "outline") in attrs
        if tag in ("td", "th"):
            self.cells.append("")
            self._in_cell = True

    def handle_endtag(self, tag: str) -> None:
        self._in_cell = self._in_cell and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._in_cell:
            self.cells[-1] += data


@pytest.fixture
def results(tmp_path: Path, known_pair: KnownPair) -> Path:
    """Real rows: a right and a loosely right answer, and an image that cannot be read."""
    write_pair(tmp_path / "pairs" / "right", known_pair)
    write_pair(tmp_path / "pairs" / "shifted", known_pair, offset=10)
    write_pair(tmp_path / "pairs" / "unreadable", known_pair)
    (tmp_path / "pairs" / "unreadable" / "near.png").write_text("no image")
    run(find_pairs(tmp_path / "pairs"), [Settings(method="sift")], tmp_path / "run" / "pairs.jsonl")
    return tmp_path / "run"


def test_files_from_real_rows(results: Path, tmp_path: Path) -> None:
    files = write_report([results], tmp_path / "report")
    assert [file.name for file in files] == [
        "report.html",
        "tables.tex",
        "results.csv",
        "results.parquet",
    ]
    page = Page(files[0].read_text(encoding="utf-8"))
    assert any("1 of 3" in cell and "33 %" in cell for cell in page.cells)  # strict
    assert any("2 of 3" in cell and "67 %" in cell for cell in page.cells)  # loose
    assert page.outlines == 2
    assert files[0].stat().st_size < 1_000_000
    assert r"sift & 3 & 33 (6--79) & 67 (21--94) & 1 &" in files[1].read_text(encoding="utf-8")
    with files[2].open(newline="", encoding="utf-8") as text:
        rows = {row["case"]: row for row in csv.DictReader(text)}
    assert (rows["right"]["strict"], rows["shifted"]["strict"]) == ("true", "false")
    assert float(rows["right"]["seconds.points"]) > 0
    assert parquet.read_table(files[3]).num_rows == 3


def test_the_page_needs_nothing_but_itself(results: Path, tmp_path: Path) -> None:
    text = write_report([results], tmp_path)[0].read_text(encoding="utf-8")
    page = Page(text)
    assert page.references
    for reference in page.references:
        assert reference.startswith(("#", "data:image/")), reference[:80]
    assert "@import" not in text
    assert "url(http" not in text


def rows_of(
    count: int, right: int, *, method: str = "sift", **more: Any
) -> Iterator[dict[str, Any]]:
    """Rows of poses in groups j=1 to j=10 in turn, of which the first are right."""
    for index in range(count):
        yield {
            "case": f"{index:04d}",
            "group": f"j={index % 10 + 1}",
            "model": "pose",
            "method": method,
            "settings": method,
            "status": "localized",
            "strict": index < right,
            "loose": index < right,
            "error": 1.0 if index < right else 40.0,
            "tags": {"distance": 1.0 + index % 10},
            "seconds": {"points": 0.25},
        } | more


def write_rows(folder: Path, rows: Iterator[dict[str, Any]], name: str = "kitti") -> Path:
    folder.mkdir(exist_ok=True)
    with (folder / f"{name}.jsonl").open("a") as out:
        out.writelines(json.dumps(row) + "\n" for row in rows)
    return folder


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [
        # Worked by hand from Wilson's formula with z = 1.96.
        (0, 10, 0.0, 0.2775),
        (5, 10, 0.2366, 0.7634),
        (10, 10, 0.7225, 1.0),
        (81, 263, 0.2553, 0.3662),
        (0, 0, 0.0, 1.0),
    ],
)
def test_wilson_intervals(count: int, of: int, low: float, high: float) -> None:
    assert Share(count, of).interval == pytest.approx((low, high), abs=5e-5)


def test_figures_are_those_of_the_rows(tmp_path: Path) -> None:
    run_folder = write_rows(tmp_path / "run", rows_of(40, 13, r_err=0.125, t_err_length=0.5))
    results = load_benchmarks([run_folder])[0].results
    total = summarize(results)
    assert (total.strict, total.unanswered) == (Share(13, 40), Share(0, 40))
    assert (total.median_error, total.median_seconds) == (40.0, 0.25)
    groups = by_group(results)
    assert list(groups) == [f"j={j}" for j in range(1, 11)]
    assert [summarize(own).strict.count for own in groups.values()] == [
        2,
        2,
        2,
        1,
        1,
        1,
        1,
        1,
        1,
        1,
    ]
    page = Page(write_report([run_folder], tmp_path)[0].read_text(encoding="utf-8"))
    assert any("13 of 40" in cell for cell in page.cells)
    assert sum(cell.startswith("2/4") for cell in page.cells) == 3
    assert "0.125" in page.cells  # mean r_err, in the table beside the paper's
    assert "1,854" in page.cells


def test_image_pairs_stand_beside_the_papers_table(tmp_path: Path) -> None:
    rows = rows_of(2, 1, model="homography", group="made", ste=1.0, ste_published=2.718281828)
    run_folder = write_rows(tmp_path / "run", rows, "pairs")
    text = write_report([run_folder], tmp_path)[0].read_text(encoding="utf-8")
    assert "Not comparable: other images" in text
    cells = Page(text).cells
    start = cells.index("SIFT (paper)")
    assert cells[start + 2] == "10.654"
    ours = start + 12
    assert cells[ours : ours + 4] == ["sift", "2", "0.000", "1.000"]


def test_methods_of_different_settings_are_told_apart(tmp_path: Path) -> None:
    write_rows(tmp_path / "a", rows_of(2, 1))
    write_rows(tmp_path / "b", rows_of(2, 2, settings="other"))
    write_rows(tmp_path / "b", rows_of(1, 0))
    results = load_benchmarks([tmp_path / "a", tmp_path / "b"])[0].results
    assert {result.method for result in results} == {"sift · sift", "sift · other"}
    of_case = [
        result.strict for result in results if (result.case, result.settings[0]) == ("0000", "s")
    ]
    assert of_case == [False]  # the later run counts


def test_lines_that_cannot_be_read_are_counted(tmp_path: Path) -> None:
    run_folder = write_rows(tmp_path / "run", rows_of(3, 3))
    with (run_folder / "kitti.jsonl").open("a") as out:
        out.write('[1]\n{"case": 3}\n\n{"case": "cut", "met')
    benchmark = load_benchmarks([run_folder])[0]
    assert (len(benchmark.results), benchmark.skipped) == (3, 3)
    page = write_report([run_folder], tmp_path)[0].read_text(encoding="utf-8")
    assert "3 lines of the result file could not be read" in page


def test_values_of_unexpected_kinds(tmp_path: Path) -> None:
    row = {
        "case": "odd",
        "method": "sift",
        "error": "far",
        "seconds": None,
        "tags": [1],
        "strict": 1,
        "far": 3,
        "far_from_near": {"homography": [[1, 0], [0, 1]]},
    }
    run_folder = write_rows(tmp_path / "run", iter([row, row | {"case": "even", "error": 2}]))
    (run_folder / "run.json").write_text(
        '{"settings": 3, "environment": {"packages": [], "cpus": 2}'
    )
    write_report([run_folder], tmp_path)
    (run_folder / "run.json").write_text(
        '{"settings": 3, "environment": {"packages": [], "cpus": 2}}'
    )
    record = load_record(run_folder)
    assert (record.settings, record.packages, record.environment) == ({}, {}, {"cpus": "2"})


def test_without_results(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError, match="no results"):
        load_benchmarks([tmp_path])
    (tmp_path / "kitti.jsonl").write_text("")
    with pytest.raises(BenchmarkError, match="nearfar bench"):
        load_benchmarks([tmp_path])
    with pytest.raises(BenchmarkError, match="missing is not a folder"):
        load_benchmarks([tmp_path / "missing"])


def test_everything_is_escaped(tmp_path: Path) -> None:
    rows = rows_of(2, 1, group=EVIL, case=EVIL, far=EVIL, near="x" + EVIL, reason=EVIL)
    run_folder = write_rows(tmp_path / "run", rows, "a&b_<i>")
    record = {"commands": [EVIL], "settings": {"sift": {EVIL: EVIL}}, "licences": {EVIL: EVIL}}
    (run_folder / "run.json").write_text(json.dumps(record))
    files = write_report([run_folder], tmp_path)
    text = files[0].read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "&lt;script&gt;" in text
    assert Page(text).scripts == 1  # the page's own
    assert r"a\&b\_<i>" in files[1].read_text(encoding="utf-8")


def test_the_narrowest_failures_and_the_hardest_successes_come_first(tmp_path: Path) -> None:
    def row(case: str, error: float | None, strict: bool, scale: float) -> dict[str, Any]:
        more: dict[str, Any] = {
            "case": case,
            "error": error,
            "strict": strict,
            "true_scale_change": scale,
        }
        return next(rows_of(1, 1, group="all", **more))

    rows = [
        row("no answer", None, False, 2),
        row("close", 3.5, False, 2),
        row("far off", 90, False, 2),
        row("easy", 2.9, True, 2),
        row("hard", 1, True, 6),
    ]
    results = load_benchmarks([write_rows(tmp_path / "run", iter(rows))])[0].results

    def names(most: int) -> list[str]:
        return [result.case for result in chosen(results, most)]

    assert names(3) == ["close", "hard", "far off"]
    assert names(1) == ["close"]


def test_of_many_results_all_methods_are_drawn_for_the_same_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plots, "MOST_POINTS", 4)
    methods = {"sift": 0, "orb": 1}
    by_method = [
        rows_of(4, 4, method=method, model="homography", true_scale_change=2.0)
        for method in methods
    ]
    in_turns = itertools.chain.from_iterable(zip(*by_method, strict=True))
    (benchmark,) = load_benchmarks([write_rows(tmp_path / "run", in_turns)])
    charts = {chart.title: chart for chart in plots.charts_of(benchmark, methods)}
    found = charts["Error against scale change"]
    assert "2 of 4 cases" in found.note
    marks = [re.findall(rf"<use [^>]*var\(--series-{n}\)", found.svg) for n in methods.values()]
    assert [len(own) for own in marks] == [3, 3]  # two cases, and one in the legend


def test_many_methods_and_missing_images(tmp_path: Path) -> None:
    for number in range(12):
        write_rows(tmp_path / "run", rows_of(10, number % 10, method=f"m{number}", far="gone.png"))
    page = write_report([tmp_path / "run"], tmp_path)[0]
    assert "Image not found: gone.png" in page.read_text(encoding="utf-8")
    assert page.stat().st_size < 1_000_000


@pytest.mark.parametrize(
    ("group", "number"), [("j=10", 10), ("4-6", 5), ("oxford", None), ("j=", None), ("", None)]
)
def test_numbers_of_groups(group: str, number: float | None) -> None:
    assert group_number(group) == number


def test_rows_have_the_types_that_the_page_relies_on(results: Path) -> None:
    benchmark = load_benchmarks([results])[0]
    by_case: dict[str, Result] = {result.case: result for result in benchmark.results}
    assert by_case["right"].homography is not None
    assert by_case["unreadable"].homography is None
    assert by_case["unreadable"].reason is not None
    assert by_case["right"].far == results.parent / "pairs" / "right" / "far.png"


def test_labels_take_the_place_of_names(tmp_path: Path) -> None:
    folder = write_rows(tmp_path / "run", rows_of(10, 5))
    page, tex, *_ = write_report([folder], tmp_path, {"sift": "SIFT & co", "kitti": "Driving"})
    assert r"SIFT \& co & 10 & 50" in tex.read_text()
    assert "Successes in Driving" in tex.read_text()
    assert "SIFT &amp; co" in page.read_text()
    for labels, said in (({"soft": "x"}, "there are kitti, sift"), ({"sift": "kitti"}, "own")):
        with pytest.raises(BenchmarkError, match=said):
            write_report([folder], tmp_path, labels)


def test_a_scale_curve_is_a_table_with_its_s50(tmp_path: Path) -> None:
    """Both base pairs succeed up to 2.5 times, and fail from 3.5 times on."""
    rows = (
        {
            "case": f"{base}/{scale}",
            "method": "sift",
            "status": "localized",
            "strict": scale < 3,
            "true_scale_change": scale,
            "tags": {"mode": "scale", "base": base},
        }
        for base in "ab"
        for scale in (1.5, 2.5, 3.5, 5.0)
    )
    folder = write_rows(tmp_path / "run", rows, "scale_curve")
    tex = write_report([folder], tmp_path)[1].read_text()
    line = next(each for each in tex.splitlines() if each.startswith("sift & 100 (100 to 100)"))
    assert line.endswith(r"& 3.0 (3.0--3.0) \\")
    assert "mode scale" in tex
