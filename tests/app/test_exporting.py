"""Answers of a batch, written by the worker."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

rasterio = pytest.importorskip("rasterio")
pyogrio = pytest.importorskip("pyogrio")

from nearfar import Localizer  # noqa: E402
from nearfar.app.exporting import exported_all  # noqa: E402
from nearfar.app.formats import write_matches  # noqa: E402
from nearfar.app.process import ExportAnswer, ExportAnswers  # noqa: E402
from nearfar.arrays import RGBPixels  # noqa: E402

METRES = 0.5
"""Side of a pixel of the overview on the ground."""


def test_formats_that_hold_many_answers_are_one_file(
    photograph: Callable[[str], RGBPixels], tmp_path: Path
) -> None:
    coffee, far = photograph("coffee"), tmp_path / "ortho.tif"
    height, width = coffee.shape[:2]
    place = rasterio.Affine(METRES, 0, 500_000, 0, -METRES, 5_400_000)
    with rasterio.open(
        far, "w", driver="GTiff", count=3, dtype="uint8", crs="EPSG:32632",
        width=width, height=height, transform=place,
    ) as out:  # fmt: skip
        out.write(np.moveaxis(coffee, -1, 0))
    localizer, answers = Localizer(max_effort="points"), []
    for name, left in (("a", 50), ("b", 250)):
        near, folder = tmp_path / f"{name}.png", tmp_path / "out" / name
        folder.mkdir(parents=True)
        Image.fromarray(coffee[100:300, left : left + 250]).resize((500, 400)).save(near)
        found = localizer.localize(far, near)
        write_matches(tmp_path / f"{name}.npz", found.points)
        answers.append(
            ExportAnswer(
                localization=found.to_dict(), matches=tmp_path / f"{name}.npz", far="ortho.tif",
                near=near.name, images="read", formats=("geopackage", "odm", "csv"),
                folder=folder, max_pixels=10**8, max_tiled_pixels=10**9,
            )
        )  # fmt: skip
    task = ExportAnswers(
        answers=tuple(answers), formats=("geopackage", "odm", "csv"), folder=tmp_path / "out"
    )
    files = {file for outcome in exported_all(task) for file in outcome.files}
    assert files == {"footprints.gpkg", "gcp_list.txt", "a/matches.csv", "b/matches.csv"}
    outlines = pyogrio.raw.read(tmp_path / "out" / "footprints.gpkg")[2]
    assert len(outlines) == 2
    marks = (tmp_path / "out" / "gcp_list.txt").read_text(encoding="utf-8").splitlines()[1:]
    for name, left in (("a", 50), ("b", 250)):
        easting, _, _, column, *_ = next(
            line.split() for line in marks if f"{name}.png" in line.split()
        )
        expected = 500_000 + METRES * (left + float(column) / 2)
        assert float(easting) == pytest.approx(expected, abs=METRES)
