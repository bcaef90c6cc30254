"""Photographs located in a map in which the images that show their scene are hidden among others.

    python benchmarks/map_retrieval.py DATA OUT [--tiles 10000] [--methods map "bag of words"]

DATA holds `pairs/` and `train/`. The far images of all pairs with a homography are hidden among the
training photographs, or among so many tiles of these; the near images are queries. The map is built
in OUT/photographs, or OUT/tiles-10000, where it is missing; results are appended to `rows.jsonl`
beside it. A run that was stopped goes on where it was. Of the far images that show the scene of a
query only that of its own pair counts; the others are left out. The last table is of the kite
survey, the pairs `copr`.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence, Set
from pathlib import Path

import numpy as np

from nearfar import open_map
from nearfar.bench.datasets.cases import Case, scene
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.evaluate import true_diagonal
from nearfar.geometry.homography import transform
from nearfar.imaging.image import read_image
from nearfar.maps import DEFAULTS
from nearfar.maps.answers import MapAnswer, MapLocalization
from nearfar.maps.files import name_of
from nearfar.maps.locate import MapLocator
from nearfar.maps.map import CANDIDATES, TOP
from nearfar.maps.store import MapStore
from nearfar.maps.tables import MapImage
from nearfar.storage.rows import Row, RowFile, read_rows
from retrieval_baselines import BagOfWords, PooledLandmarks, WholeImage
from retrieval_tables import kite_table, recall_table, time_table
from retrieval_tiles import tiles_of

KITE = "copr"
SAME = {"mag": "LePoint1"}
"""Scenes that go by two names."""
METHODS = ("map", "whole image", "pooled landmarks", "bag of words")

Answer = Callable[[Case], Row]


def scene_of(case: Case) -> str:
    """What pairs of one scene have in common; all photographs of the kite survey show one."""
    name = scene(case.name)
    return KITE if case.group == KITE else SAME.get(name, name)


def about(case: Case, method: str) -> Row:
    """What a row says before its results."""
    return {
        "method": method,
        "case": case.name,
        "group": case.group,
        "scene": scene_of(case),
        "scale_change": case.scale_change,
    }


def build(files: Iterable[Path], folder: Path) -> None:
    """Build the map of the files by other processes, so that this one's memory is a reader's."""
    commands = [["build", *map(str, files), "--out", str(folder)], ["compact", str(folder)]]
    for command in commands:
        subprocess.run([sys.executable, "-m", "nearfar", "map", *command], check=True)


class Judge:
    """Says whether images of a map show what a query shows, and where."""

    def __init__(self, cases: Iterable[Case], folder: Path) -> None:
        self._folder = folder
        self._scenes: dict[str, set[str]] = {}
        for case in cases:
            self._scenes.setdefault(scene_of(case), set()).add(self.own(case))

    def own(self, case: Case) -> str:
        """The name in the map of the far image of a pair."""
        return name_of(case.far, self._folder)

    def left_out(self, case: Case) -> set[str]:
        """The far images of other pairs that show the scene as well."""
        return self._scenes[scene_of(case)] - {self.own(case)}

    def rank(self, case: Case, images: Sequence[str]) -> int | None:
        """Of the pair's far image, from 1 on; None where it is not among the images."""
        counted = [name for name in images if name not in self.left_out(case)]
        own = self.own(case)
        return counted.index(own) + 1 if own in counted else None

    def errors(self, case: Case, answer: MapAnswer) -> list[float] | None:
        """Mean and largest error at the true points, as shares of the true footprint's diagonal.

        None in another image.
        """
        if answer.image != self.own(case):
            return None
        away = transform(np.asarray(answer.far_from_near), case.near_points) - case.far_points
        near = read_image(case.near)
        shares = np.hypot(*away.T) / true_diagonal(case, near.width, near.height)
        return [float(shares.mean()), float(shares.max())]


class StoreWithout(MapStore):
    """A map of which some images do not count."""

    def __init__(self, folder: Path, names: Set[str]) -> None:
        super().__init__(folder)
        self._names = names

    def images(self) -> list[MapImage]:
        """The images that count."""
        return [image for image in super().images() if image.name not in self._names]


def by_map(folder: Path, judge: Judge) -> Answer:
    """The image with most votes, and the verified answer."""

    def answer(case: Case) -> Row:
        locator = MapLocator(StoreWithout(folder, judge.left_out(case)), DEFAULTS)
        start = time.process_time()
        found = locator.locate(case.near, TOP, CANDIDATES)
        by_votes = sorted(found.candidates, key=lambda each: -each.votes)
        return {
            "rank": judge.rank(case, [each.image for each in by_votes]),
            "candidates": [each.to_dict() for each in found.candidates],
            "answer": verified(case, found, judge),
            "seconds": found.seconds,
            "processor_seconds": time.process_time() - start,
            "peak_megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }

    return answer


def verified(case: Case, found: MapLocalization, judge: Judge) -> Row | None:
    """The best answer."""
    if not found.answers:
        return None
    best = found.answers[0]
    return {
        "image": best.image,
        "errors": judge.errors(case, best),
        "confidence": best.confidence,
        "step": best.localization.step,
        "far_from_near": np.asarray(best.far_from_near).tolist(),
    }


def by_ranking(ranked: Callable[[Path], list[str]], judge: Judge) -> Answer:
    """The answers of a method that ranks all images."""
    return lambda case: {"rank": judge.rank(case, ranked(case.near))}


def prepared(
    method: str, folder: Path, judge: Judge, far: Sequence[Path], others: Sequence[Path]
) -> Answer:
    """A method, ready to answer.

    Args:
        method: its name.
        folder: of the map.
        judge: of the answers.
        far: images of the map that queries show.
        others: the other images of the map, of which words are learned.
    """
    match method:
        case "map":
            return by_map(folder, judge)
        case "whole image":
            files = {name_of(file, folder): file for file in (*far, *others)}
            return by_ranking(WholeImage(files).ranked, judge)
        case "pooled landmarks":
            return by_ranking(PooledLandmarks(MapStore(folder)).ranked, judge)
        case _:
            names = {name_of(file, folder) for file in others}
            words = BagOfWords(MapStore(folder), names, folder.parent / "words.npy")
            return by_ranking(words.ranked, judge)


def main() -> None:
    """Build, run and sum up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tiles", type=int, help="tiles among which the far images are hidden")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    parser.add_argument("--sets", nargs="+", help="sets of pairs that are queries; all")
    asked = parser.parse_args()
    out = asked.out / (f"tiles-{asked.tiles}" if asked.tiles else "photographs")
    cases = [case for case in find_pairs(asked.data / "pairs") if case.model == "homography"]
    far = list(dict.fromkeys(case.far for case in cases))
    others = sorted((asked.data / "train").rglob("*.jpg"))
    if asked.tiles:
        others = tiles_of(others, asked.tiles, out / "tiles")
    folder, results = out / "map", out / "rows.jsonl"
    build([*far, *others], folder)
    judge = Judge(cases, folder)
    done = {(row["method"], row["case"]) for row in read_rows(results)}
    queries = [case for case in cases if not asked.sets or case.group in asked.sets]
    with RowFile(results) as file:
        for method in asked.methods:
            todo = [case for case in queries if (method, case.name) not in done]
            if todo:
                answer = prepared(method, folder, judge, far, others)
                for case in todo:
                    file.append(about(case, method) | answer(case))
                    print(method, case.name, flush=True)
    rows, images = read_rows(results), open_map(folder).images
    print(f"{len(images)} images, {sum(image.landmarks for image in images)} landmarks")
    print(recall_table(rows), time_table(rows), sep="\n\n")
    print(kite_table(rows, asked.data / "pairs" / KITE / "gcp.csv"))


if __name__ == "__main__":
    main()
