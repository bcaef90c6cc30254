"""Low against high altitude: photographs straight down, by the ratio of their heights."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from nearfar.bench.datasets.cases import Case, scene
from nearfar.bench.datasets.pairs import find_pairs
from nearfar.bench.figures import plot_curve
from nearfar.bench.results import Result
from nearfar.bench.studies.curves import bin_name, half_table, outcomes, rate_table
from nearfar.bench.study import STUDIES, Study
from nearfar.bench.tables import success_table, time_table
from nearfar.errors import BenchmarkError

LARGEST_STRETCH = 1.25
"""Largest ratio of the scale along one direction to that across it. A camera that is tilted by 37
degrees stretches the ground by that much."""


def stretch(case: Case) -> float:
    """Return the ratio of the scales along and across, at the middle of the near points."""
    homography, _ = cv2.findHomography(case.near_points, case.far_points, 0)
    if homography is None:
        return np.inf
    x, y = case.near_points.mean(axis=0)
    u, v, w = homography @ (x, y, 1.0)
    far = np.array([[u / w], [v / w]])
    local = (homography[:2, :2] - far @ homography[2:, :2]) / w
    large, small = np.linalg.svd(local, compute_uv=False)
    return float(large / small) if small > 0 else np.inf


@STUDIES.register("altitude")
class Altitude(Study):
    """Success by the ratio of heights, on pairs of photographs straight down, by site.

    From above, the scale change of two photographs of one camera is the ratio of their heights.
    """

    def cases(self, folder: Path) -> list[Case]:
        """See `Study.cases`. A site is a set of pairs."""
        found = [
            replace(case, tags={**case.tags, "mode": "altitude", "base": scene(case.name)})
            for case in find_pairs(folder)
            if case.model == "homography"
            and case.scale_change
            and bin_name(case.scale_change)
            and stretch(case) <= LARGEST_STRETCH
        ]
        if not found:
            raise BenchmarkError(f"there are no pairs of photographs straight down in {folder}")
        return found

    def tables(self, results: Sequence[Result]) -> dict[str, str]:
        """See `Study.tables`."""
        strict, loose = outcomes(results), outcomes(results, "loose")
        seed = self.settings.seed
        return {
            "Success in percent by the ratio of heights, with 95 % intervals": (
                rate_table(strict, loose, seed)
            ),
            "Ratio of heights at which success falls to one half": half_table(strict, loose, seed),
            "Successes by site, strict / loose": success_table(results),
            "Median seconds by stage, where it ran": time_table(results),
        }

    def plots(self, results: Sequence[Result], folder: Path) -> list[Path]:
        """See `Study.plots`."""
        title = "Photographs straight down, by the ratio of their heights"
        return plot_curve(outcomes(results), title, folder / "altitude", self.settings.seed)
