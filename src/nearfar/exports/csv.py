"""Matched points as CSV, for spreadsheets and data frames."""

import csv
from pathlib import Path

from nearfar.exports import EXPORTERS, Exporter, Subject
from nearfar.storage import replaced


@EXPORTERS.register("csv")
class CsvExporter(Exporter):
    """One row a match: far_x, far_y, near_x, near_y in pixels, inlier 1 or 0."""

    file_name = "matches.csv"

    def write(self, subject: Subject, path: Path) -> list[Path]:
        """See `Exporter.write`."""
        points = subject.localization.points
        with replaced(path) as out, out.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(["far_x", "far_y", "near_x", "near_y", "inlier"])
            for far, near, inlier in zip(points.far, points.near, points.inliers, strict=True):
                table.writerow([*far.tolist(), *near.tolist(), int(inlier)])
        return [path]
