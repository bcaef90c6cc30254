"""Success of maps against scale change: close-ups sought among made overviews and photographs.

    python benchmarks/map_scale_curve.py PAIRS PHOTOS OUT [--factors 4 8 12 16 24] [--others 40]

For each factor, the far image of each base pair is reduced by it and set into a scene, as in
`nearfar bench scale-curve --mode scale`. A map has these scenes and other photographs. The near
images are the queries. An answer is correct if it lies in the scene of its own pair, with a mean
error below 3 pixels. Rows go to OUT/map_scale_curve.jsonl; a run that was stopped goes on.
"""

import argparse
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import nearfar
from nearfar.bench.datasets.cases import Case, scene
from nearfar.bench.datasets.composites import Backgrounds
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.evaluate import true_diagonal
from nearfar.bench.results import Result
from nearfar.bench.studies.curves import half_table, outcomes, rate_table
from nearfar.bench.studies.scale_curve import PlannedCase, base_pairs, make_images, plan_cases
from nearfar.bench.tables import markdown
from nearfar.geometry.homography import transform
from nearfar.imaging.image import read_image
from nearfar.maps.answers import MapLocalization
from nearfar.maps.files import name_of
from nearfar.maps.map import Map
from nearfar.storage.rows import Row, RowFile, read_rows

SETS = ("homogr", "oxford")
STRICT = 3.0
"""Largest mean error of a correct answer, in pixels of the map image."""
LOOSE = 0.1
"""Largest mean error of a loose success, as a share of the diagonal of the true outline."""
CONFIDENT = 0.9
SEED = 0


def one_of_each_scene(cases: Sequence[Case]) -> list[Case]:
    """Return the first pair of each scene."""
    first: dict[str, Case] = {}
    for case in cases:
        first.setdefault(scene(case.name).rpartition("/")[2], case)
    return list(first.values())


def map_of(plans: Sequence[PlannedCase], others: Path, folder: Path) -> Map:
    """Return the map of other photographs with the made scenes of one factor, building it once."""
    complete = folder.with_name(folder.name + ".complete")
    if not complete.exists():
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(others, folder)
        nearfar.open_map(folder).add([plan.case.far for plan in plans])
        complete.touch()
    return nearfar.open_map(folder)


def row_of(case: Case, own: str, found: MapLocalization, seconds: float) -> Row:
    """Return the row of a query: its answer beside the truth.

    Args:
        case: the query is its near image.
        own: name of its far image in the map.
        found: what the map answers.
        seconds: CPU seconds of the query.
    """
    by_votes = sorted(found.candidates, key=lambda each: -each.votes)
    ranked = list(dict.fromkeys(each.image for each in by_votes))
    row: Row = {
        "case": case.name,
        "method": "map",
        "model": case.model,
        "true_scale_change": case.scale_change,
        "tags": {name: case.tags[name] for name in ("base", "factor")} | {"mode": "map"},
        "status": "failed",
        "strict": False,
        "loose": False,
        "rank": ranked.index(own) + 1 if own in ranked else None,
        "seconds": {"query": seconds},
    }
    if not found.answers:
        return row
    best = found.answers[0]
    row |= {"status": "localized", "confidence": best.confidence, "right_image": False}
    if best.image == own:
        away = transform(np.asarray(best.far_from_near), case.near_points) - case.far_points
        error = float(np.hypot(*away.T).mean())
        near = read_image(case.near)
        limit = max(STRICT, LOOSE * true_diagonal(case, near.width, near.height))
        row |= {"right_image": True, "error": error, "strict": error < STRICT}
        row["loose"] = error < limit
    return row


def show(rows: Sequence[Row]) -> None:
    """Print success by scale change, S50, and what the maps' confidence says."""
    results = [Result.from_dict(row) for row in rows]
    strict, loose = outcomes(results), outcomes(results, "loose")
    print(rate_table(strict, loose, SEED), half_table(strict, loose, SEED), sep="\n\n")
    lines = []
    for factor in sorted({each.tags["factor"] for each in results}):
        own = [each for each in results if each.tags["factor"] == factor]
        sure = [each for each in own if each.measures.get("confidence", 0.0) >= CONFIDENT]
        counts = (
            sum(each.row["rank"] == 1 for each in own),
            sum(each.strict for each in own),
            len(sure),
            sum(not each.strict for each in sure),
        )
        lines.append([f"{factor:g}", str(len(own)), *map(str, counts)])
    header = ["factor", "queries", "own scene has most votes", "correct"]
    print("\n" + markdown([*header, f"confidence {CONFIDENT} or more", "of them incorrect"], lines))


def run(asked: argparse.Namespace) -> list[Row]:
    """Build the maps that are missing, and locate the queries that have no row."""
    bases = one_of_each_scene(base_pairs(find_pairs(asked.pairs), SETS))
    images = [image for case in bases for image in (case.far, case.near)]
    photographs = sorted(asked.photos.glob("*.jpg"))
    backgrounds = Backgrounds(asked.photos, pair_images=images)
    others, file = asked.out / "others", asked.out / "map_scale_curve.jsonl"
    if not others.exists():
        nearfar.open_map(others, create=True).add(photographs[:: len(photographs) // asked.others])
    done = {row["case"] for row in read_rows(file)}
    with RowFile(file) as out:
        for factor in asked.factors:
            plans = plan_cases(
                bases, asked.out / "cases", modes=["scale"], factors=[factor], seed=SEED
            )
            make_images(plans, backgrounds, SEED)
            map_ = map_of(plans, others, asked.out / f"map-{factor:g}")
            for case in (plan.case for plan in plans if plan.case.name not in done):
                begun = time.process_time()
                found = map_.locate(case.near)
                own, seconds = name_of(case.far, map_.folder), time.process_time() - begun
                out.append(row_of(case, own, found, seconds))
    return read_rows(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pairs", type=Path)
    parser.add_argument("photos", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--factors", type=float, nargs="+", default=[4.0, 8.0, 12.0, 16.0, 24.0])
    parser.add_argument("--others", type=int, default=40, help="other photographs in each map")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    show(run(asked))


if __name__ == "__main__":
    main()
