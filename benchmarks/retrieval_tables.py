"""Tables of the results of `map_retrieval.py`."""

import csv
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from nearfar.bench.tables import distinct, markdown
from nearfar.geometry.homography import transform
from nearfar.storage.rows import Row

BINS = ((0.0, 4.0), (4.0, 12.0))
"""Of the scale change; the upper end is included."""
SURE = 0.9
"""Confidence of answers that must not be wrong."""
CLOSE = 0.03
"""Error at a true point that makes an answer wrong, as a share of the footprint's diagonal."""


def voted(row: Row) -> bool:
    """Whether the first image shows the scene."""
    return bool(row["rank"] == 1)


def answered(row: Row) -> bool:
    """Whether the answer after verification is the right place in the right image."""
    errors = row["answer"] and row["answer"]["errors"]
    return bool(errors and errors[1] < CLOSE)


def wrong_and_sure(row: Row) -> bool:
    """Whether there is an answer that should not have been given."""
    found = row["answer"]
    return bool(found and found["confidence"] >= SURE and not answered(row))


def recall_table(rows: Sequence[Row]) -> str:
    """Of how many queries each method has the right image first, of all and of each scene."""
    columns: dict[str, tuple[str, Callable[[Row], bool]]] = {
        name: (name, voted) for name in dict.fromkeys(row["method"] for row in rows)
    }
    columns["map, verified"] = "map", answered
    columns["sure and wrong"] = "map", wrong_and_sure
    lines = []
    for low, high in BINS:
        inside = [row for row in rows if low < row["scale_change"] <= high]
        for scene in ["all", *sorted({row["scene"] for row in inside})]:
            own = [row for row in inside if scene in ("all", row["scene"])]
            line = [f"{low:g} to {high:g}", scene, str(len({row["case"] for row in own}))]
            for method, holds in columns.values():
                chosen = [holds(row) for row in own if row["method"] == method]
                line.append(f"{sum(chosen)} of {len(chosen)}")
            lines.append(line)
    return markdown(["scale change", "scene", "queries", *columns], lines)


def time_table(rows: Sequence[Row]) -> str:
    """Seconds of the stages of a query."""
    chosen = [row for row in rows if row["method"] == "map"]
    if not chosen:
        return ""
    own = [row["seconds"] for row in chosen]
    names = distinct(stage for each in own for stage in each)
    stages = {stage: [each.get(stage, 0.0) for each in own] for stage in names}
    stages["all"] = [sum(each.values()) for each in own]
    stages["all, of processors"] = [row["processor_seconds"] for row in chosen]
    lines = [
        [stage, *(f"{value:.2f}" for value in np.percentile(seconds, [50, 90, 100]))]
        for stage, seconds in stages.items()
    ]
    largest = max(row["peak_megabytes"] for row in chosen)
    table = markdown(["seconds", "median", "90 %", "largest"], lines)
    return f"{table}\n\nlargest resident memory {largest:.0f} MB"


def kite_table(rows: Sequence[Row], clicks: Path) -> str:
    """The kite survey: each photograph, and how well shared control points agree in the map."""
    own = [row for row in rows if row["method"] == "map" and row["group"] == "copr"]
    lines = []
    for row in sorted(own, key=lambda each: each["scale_change"]):
        found = row["answer"]
        line = [row["case"], f"{row['scale_change']:.1f}", str(row["rank"])]
        if found is None or not found["errors"]:
            line += ["no" if found is None else found["image"], "", "", ""]
        else:
            errors = [f"{100 * share:.2f} %" for share in found["errors"]]
            line += ["yes", *errors, f"{found['confidence']:.2f}"]
        lines.append(line)
    header = ["photograph", "scale change", "rank", "found", "mean error", "largest", "confidence"]
    apart = [
        f"{point}: {distance:.2f} pixels ({', '.join(names)})"
        for point, names, distance in control_points(own, clicks)
    ]
    return "\n".join(
        [markdown(header, lines), "", "control points of several photographs:", *apart]
    )


def control_points(rows: Sequence[Row], clicks: Path) -> list[tuple[str, list[str], float]]:
    """Points that were clicked in several photographs, and the largest distance in the map."""
    homography = {
        row["case"].rpartition("/")[2]: np.array(row["answer"]["far_from_near"])
        for row in rows
        if row["answer"] and row["answer"]["errors"]
    }
    places: dict[str, dict[str, np.ndarray]] = {}
    with clicks.open(newline="") as file:
        for click in csv.DictReader(file):
            if click["pair"] in homography and not click["note"]:
                xy = np.array([[float(click["x"]), float(click["y"])]])
                place = transform(homography[click["pair"]], xy)[0]
                places.setdefault(click["gcp"], {})[click["pair"]] = place
    return [
        (point, list(own), max(float(np.hypot(*(one - other))) for one, other in pairs))
        for point, own in sorted(places.items())
        if (pairs := list(itertools.combinations(own.values(), 2)))
    ]
