"""The report of the paper's experiments: its tables and figures beside those measured here."""

import base64
from collections.abc import Sequence
from pathlib import Path

from nearfar.bench.paper_tables import (
    PAPER_GRID,
    Cells,
    percentages,
    table_one,
    table_three_grid,
)
from nearfar.bench.published import Comparison, table_three, table_two
from nearfar.bench.report.page import environment
from nearfar.bench.report.paper_figures import draw_figures
from nearfar.bench.results import Result, load_benchmarks

SWEEP_TITLE = "The sweep over layers and sizes on KITTI, beside the paper's Table II"
RELEASED_RULES = (
    "By the rule of the released code a pose without a length from stereo is a failure: {count} of "
    "{total} poses."
)

ERRORS = (
    "{count} of {total} rows of {name} are errors, which count as failures. The first: {reason}. "
    "The same command tries them again."
)


def results_of(out: Path) -> dict[str, list[Result]]:
    """Return the results of each part that has some, by the name of its file."""
    return {each.name: list(each.results) for each in load_benchmarks([out])}


def paper_tables(found: dict[str, list[Result]], printed: Cells = PAPER_GRID) -> list[Comparison]:
    """Return every table of the paper that the results allow.

    Args:
        found: results by part.
        printed: cells of the paper's Table III.
    """
    pairs, frames = found.get("paper_pairs", []), found.get("paper_kitti", [])
    sweep = found.get("paper_sweep", [])
    tables: list[Comparison | None] = [table_one()]
    if frames:
        tables += [table_two(frames), percentages(frames)]
    if sweep:
        tables.append(table_two(sweep, SWEEP_TITLE))
    if pairs:
        tables += [table_three_grid(pairs, method, printed) for method in ("paper", "objects")]
        tables.append(table_three(pairs))
    return [each for each in tables if each is not None]


def notes_on(found: dict[str, list[Result]], notes: Sequence[str]) -> list[str]:
    """Return what a reader must know: stand-ins, errors, and failures by the released code."""
    stereo = [
        each for each in found.get("paper_kitti", []) if each.row.get("no_stereo_scale") is not None
    ]
    texts = list(notes)
    for name, results in found.items():
        errors = [each for each in results if each.status == "error"]
        if errors:
            texts.append(
                ERRORS.format(
                    count=f"{len(errors):,}",
                    total=f"{len(results):,}",
                    name=name,
                    reason=errors[0].reason,
                )
            )
    if stereo:
        count = sum(each.row["no_stereo_scale"] is True for each in stereo)
        texts.append(RELEASED_RULES.format(count=f"{count:,}", total=f"{len(stereo):,}"))
    return texts


def write_paper_report(
    out: Path, folder: Path, notes: Sequence[str], printed: Cells = PAPER_GRID
) -> list[Path]:
    """Write `paper.html`, `paper.md`, `paper.tex` and the figures, and return their paths.

    Args:
        out: folder of the results.
        folder: where to write.
        notes: sentences on the run, such as what stands in for the paper's data.
        printed: cells of the paper's Table III.

    Raises:
        BenchmarkError: there are no results.
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = results_of(out)
    tables, texts = paper_tables(found, printed), notes_on(found, notes)
    figures = draw_figures(found.get("paper_pairs", []), found.get("paper_kitti", []), folder)
    pictures = {
        title: [base64.b64encode(file.read_bytes()).decode() for file in files]
        for title, files in figures.items()
    }
    template = environment().get_template("paper.html.jinja")
    page = template.render(tables=tables, notes=texts, pictures=pictures)
    html, text, tex = (folder / f"paper.{suffix}" for suffix in ("html", "md", "tex"))
    html.write_text(page, encoding="utf-8")
    text.write_text(_markdown(tables, texts, figures), encoding="utf-8")
    parts = ["% Needs \\usepackage{booktabs}", *(each.latex() for each in tables)]
    tex.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return [html, text, tex, *(file for files in figures.values() for file in files)]


def _markdown(
    tables: Sequence[Comparison], notes: Sequence[str], figures: dict[str, list[Path]]
) -> str:
    parts = ["# The paper's experiments", *notes]
    for each in tables:
        parts += [f"## {each.title}", each.note, each.markdown()]
    for title, files in figures.items():
        parts += [f"## {title}", *(f"![{title}]({file.name})" for file in files)]
    return "\n\n".join(parts) + "\n"
