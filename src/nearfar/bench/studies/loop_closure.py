"""Loop closure: is a place of a KITTI drive recognized when the drive comes back to it?

Each frame is a query among all frames before it that lie far enough back on the way. The landmarks
of maps (`nearfar.maps`) retrieve candidates, and the methods that are compared verify them.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nearfar.bench.datasets.cases import Case
from nearfar.bench.results import Result
from nearfar.bench.studies.kitti import STEP, read_calibration, read_poses
from nearfar.bench.study import STUDIES, Study
from nearfar.bench.summary import by_group, by_method
from nearfar.bench.tables import markdown, time_table
from nearfar.errors import BenchmarkError
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import Intrinsics, of_projection
from nearfar.imaging.image import read_image
from nearfar.localization import Localization
from nearfar.localizer import Localizer
from nearfar.render.plotting import figure_axes, save_figure
from nearfar.runtime import require
from nearfar.settings import Settings
from nearfar.storage.rows import Row

if TYPE_CHECKING:
    from nearfar.maps.landmarks import LandmarkDescriber, Landmarks

WAY_BETWEEN = 50.0
"""Metres of the drive between a query and the frames that it may be recognized in."""
NEAR, FAR = 10.0, 25.0
"""Largest distance in metres of a revisit, and of one that only comes near the place."""
REVERSE = 90.0
"""Difference of gaze in degrees from which on a revisit is in reverse."""
CANDIDATES = 3
"""Number of retrieved frames that are verified."""
KINDS = ("same direction", "reverse", "far", "none")
"""Groups of queries: revisits within 10 m, and in reverse; within 25 m; places that are new."""


@dataclass(frozen=True, eq=False)
class Drive:
    """The frames of a sequence that have images.

    Attributes:
        frames: paths of the N images, in their order.
        poses: (N, 4, 4) transforms from the camera to the world, in metres.
        way: (N,) metres driven before each frame.
        intrinsics: of two frames.
    """

    frames: tuple[Path, ...]
    poses: NDArray[np.float64]
    way: NDArray[np.float64]
    intrinsics: Intrinsics

    def before(self, index: int) -> NDArray[np.intp]:
        """Return the indices of the frames that frame `index` may be recognized in."""
        return np.flatnonzero(self.way <= self.way[index] - WAY_BETWEEN)

    def distance(self, index: int, others: NDArray[np.intp] | int) -> NDArray[np.float64]:
        """Return the distances in metres between the cameras of frames."""
        apart = self.poses[others, :3, 3] - self.poses[index, :3, 3]
        return np.asarray(np.linalg.norm(apart, axis=-1), np.float64)

    def kind(self, index: int, nearest: int) -> str:
        """Return the member of `KINDS` of a query, by its nearest frame of those before."""
        distance = float(self.distance(index, nearest))
        gaze = float(self.poses[index, :3, 2] @ self.poses[nearest, :3, 2])
        if distance <= NEAR:
            return KINDS[1] if gaze < np.cos(np.radians(REVERSE)) else KINDS[0]
        return KINDS[2] if distance <= FAR else KINDS[3]


@functools.lru_cache(maxsize=32)
def read_drive(sequence: Path) -> Drive | None:
    """Read a sequence of the official layout; None where it has no images.

    Raises:
        BenchmarkError: poses or the projection of the camera are missing.
    """
    number = next((n for n in (2, 0) if (sequence / f"image_{n}").is_dir()), None)
    if number is None:
        return None
    poses = read_poses(sequence.parent.parent / "poses" / f"{sequence.name}.txt")
    left = read_calibration(sequence / "calib.txt").get(f"P{number}")
    if left is None:
        raise BenchmarkError(f"calibration {sequence / 'calib.txt'} has no P{number}")
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    files = {n: sequence / f"image_{number}" / f"{n:06d}.png" for n in range(0, len(poses), STEP)}
    there = [n for n, file in files.items() if file.exists()]
    camera = of_projection(left)
    return Drive(
        tuple(files[n] for n in there), poses[there], way[there], Intrinsics(camera, camera)
    )


@functools.lru_cache(maxsize=1)
def _describer() -> "LandmarkDescriber":
    require("map", "lancedb", "pyarrow")
    from nearfar.maps.landmarks import LandmarkDescriber

    return LandmarkDescriber(Settings())


@functools.lru_cache(maxsize=8192)
def _map_landmarks(image: Path) -> "Landmarks":
    from nearfar.maps.landmarks import whole_scales

    pixels = read_image(image).pixels
    return _describer().of_map(pixels, whole_scales(pixels.shape[1], pixels.shape[0]))


def retrieved(drive: Drive, index: int, most: int = CANDIDATES) -> list[tuple[int, float]]:
    """Return the frames before a query that most votes of its landmarks are for, with the votes.

    Args:
        drive: the sequence. The landmarks of its frames are computed once in a process.
        index: the query.
        most: largest number of frames.
    """
    describer = _describer()
    from nearfar.maps.retrieval import HITS
    from nearfar.maps.search import nearest
    from nearfar.maps.tables import Block
    from nearfar.maps.voting import HYPOTHESES_PER_IMAGE, find_hypotheses, votes_of

    places = drive.before(index).tolist()
    blocks = []
    for place in places:
        known = _map_landmarks(drive.frames[place])
        where = np.column_stack([known.centre, known.side]).astype(np.float32)
        blocks.append(Block(np.full(len(known), place, np.int64), where, known.vectors))
    pixels = read_image(drive.frames[index]).pixels
    size = pixels.shape[1], pixels.shape[0]
    query = describer.of_query(pixels)
    hits = nearest(blocks, query.vectors, HITS, places)
    found = find_hypotheses(votes_of(hits, query, size), size, HYPOTHESES_PER_IMAGE * most)
    best: dict[int, float] = {}
    for each in found:
        best[each.image] = max(each.votes, best.get(each.image, 0.0))
    return sorted(best.items(), key=lambda item: -item[1])[:most]


def _score(found: Localization) -> tuple[float, float]:
    """Return what verified candidates are ordered by: the confidence, then chance."""
    return found.confidence or 0.0, -(found.log10_nfa or 0.0)


@dataclass(frozen=True)
class Curve:
    """Precision and recall of a method, from the most confident answer on.

    Attributes:
        confidence: least confidence of the answers that count.
        precision: share of these answers within 25 m of the query.
        recall: share of the revisits with such an answer.
    """

    confidence: NDArray[np.float64]
    precision: NDArray[np.float64]
    recall: NDArray[np.float64]

    def recall_at(self, precision: float) -> float:
        """Return the largest recall with at least this precision; 0 where there is none."""
        return float(self.recall[self.precision >= precision].max(initial=0.0))


def curve_of(results: Sequence[Result]) -> Curve:
    """Return precision and recall of one method's results."""
    revisits = sum(each.group != KINDS[3] for each in results)
    answers = sorted(
        (each for each in results if each.localized), key=lambda each: -_confidence(each)
    )
    correct = np.cumsum([each.strict for each in answers], dtype=np.float64)
    return Curve(
        np.array([_confidence(each) for each in answers], np.float64),
        correct / np.arange(1, len(answers) + 1),
        correct / max(1, revisits),
    )


def _confidence(result: Result) -> float:
    return result.measures.get("confidence", 0.0)


CONFIDENCES = (0.0, 0.5, 0.9, 0.99)


def precision_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, how many answers have a confidence, and how many are correct."""
    lines = []
    for method, own in by_method(results).items():
        revisits = sum(each.group != KINDS[3] for each in own)
        for least in CONFIDENCES:
            answers = [each for each in own if each.localized and _confidence(each) >= least]
            correct = sum(each.strict for each in answers)
            cells = (f"{least:g}", f"{len(answers)}", f"{correct}", f"{revisits}")
            lines.append([method, *cells])
        best = curve_of(own).recall_at(1.0)
        lines.append([method, "recall at precision 1", "", f"{best * revisits:.0f}", f"{revisits}"])
    return markdown(["method", "confidence from", "answers", "correct", "revisits"], lines)


def kind_table(results: Sequence[Result]) -> str:
    """Return, in Markdown, correct answers by kind of revisit; of new places, those refused."""
    lines = []
    for kind, own in by_group(results).items():
        cells = []
        for each in by_method(own).values():
            good = sum(not e.localized if kind == KINDS[3] else e.strict for e in each)
            first = sum(e.measures.get("retrieved", 0.0) > 0 for e in each)
            retrieval = "" if kind == KINDS[3] else f" (among the candidates: {first})"
            cells.append(f"{good} of {len(each)}{retrieval}")
        lines.append([kind, *cells])
    return markdown(["query", *by_method(results)], lines)


@STUDIES.register("loop-closure")
class LoopClosure(Study):
    """Recognize the places of KITTI drives that come back to them; needs the extra `map`."""

    def cases(self, folder: Path) -> list[Case]:
        """See `Study.cases`. The far image of a case is the nearest of the frames before it."""
        found = []
        for sequence in sorted((folder / "sequences").glob("*")):
            drive = read_drive(sequence)
            if drive is None:
                continue
            queries = (index for index in range(len(drive.frames)) if len(drive.before(index)))
            found += [_case(sequence, drive, index) for index in queries]
        if not found:
            raise BenchmarkError(
                f"there are no KITTI images {WAY_BETWEEN:g} m apart in {folder / 'sequences'}"
            )
        return found

    def measure(self, case: Case, localizer: Localizer) -> Row:
        """Retrieve frames for a query and verify them; see `Study.measure`."""
        drive = read_drive(case.near.parent.parent)
        if drive is None:
            raise BenchmarkError(f"the images of {case.name} are gone")
        index = drive.frames.index(case.near)
        candidates = retrieved(drive, index)
        there = [(place, votes, float(drive.distance(index, place))) for place, votes in candidates]
        best, answer = None, None
        seconds: dict[str, float] = {}
        for place, votes, distance in there:
            found = localizer.localize(
                drive.frames[place], case.near, model="pose", intrinsics=drive.intrinsics
            )
            for stage, spent in found.seconds.items():
                seconds[stage] = seconds.get(stage, 0.0) + spent
            if found.localized and (best is None or _score(found) > _score(best)):
                best, answer = found, (place, votes, distance)
        row: Row = {
            "retrieved": sum(distance <= FAR for *_, distance in there),
            "seconds": seconds,
            "strict": False,
            "loose": False,
        }
        if best is None or answer is None:
            return row | {"status": "failed", "reason": "no candidate was verified"}
        place, votes, distance = answer
        return row | {
            "strict": distance <= FAR,
            "loose": distance <= FAR,
            "metres": distance,
            "place": drive.frames[place].stem,
            "votes": votes,
            "confidence": best.confidence,
            "log10_nfa": best.log10_nfa,
        }

    def tables(self, results: Sequence[Result]) -> dict[str, str]:
        """See `Study.tables`."""
        return {
            "Answers within 25 m, by confidence": precision_table(results),
            "Correct answers by kind of revisit; of new places, no answer": kind_table(results),
            "Median seconds by stage, where it ran": time_table(results),
        }

    def plots(self, results: Sequence[Result], folder: Path) -> list[Path]:
        """Draw precision against recall; see `Study.plots`."""
        if all(each.group == KINDS[3] for each in results):
            return []
        figure, axes = figure_axes(5.5, 4.5)
        for method, own in by_method(results).items():
            curve = curve_of(own)
            axes.step(curve.recall, curve.precision, where="post", marker=".", label=method)
        axes.set(xlabel="recall", ylabel="precision", xlim=(0, 1.02), ylim=(0, 1.02))
        axes.legend()
        return [save_figure(figure, folder / "loop_closure.png")]


def _case(sequence: Path, drive: Drive, index: int) -> Case:
    places = drive.before(index)
    distances = drive.distance(index, places)
    nearest = int(places[distances.argmin()])
    relative = np.linalg.inv(drive.poses[nearest]) @ drive.poses[index]
    return Case(
        name=f"{sequence.name}/{drive.frames[index].stem}",
        group=drive.kind(index, nearest),
        far=drive.frames[nearest],
        near=drive.frames[index],
        model="pose",
        scale_change=None,
        far_points=np.empty((0, 2)),
        near_points=np.empty((0, 2)),
        pose=RelativePose(relative[:3, :3], relative[:3, 3]),
        intrinsics=drive.intrinsics,
        tags={"sequence": sequence.name, "distance": float(distances.min())},
    )
