"""What the app says of an answer, or of its lack, in plain words."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from nearfar import Settings
from nearfar.app.results import explanation, warning
from nearfar.arrays import RGBPixels
from nearfar.imaging.image import read_image
from nearfar.mirroring import with_hint
from nearfar.models import FAILURE_KINDS
from tests.app.browser import Page
from tests.app.conftest import Server
from tests.app.test_api import ended
from tests.conftest import KnownPair
from tests.render.build import localized

BLANK = read_image(np.zeros((150, 200), np.uint8))


def outcome(server: Server, folder: Path, far: RGBPixels, near: RGBPixels) -> dict[str, Any]:
    refs = []
    for name, pixels in (("whole.png", far), ("part.png", near)):
        Image.fromarray(np.ascontiguousarray(pixels)).save(folder / name)
        refs.append(server.send(folder / name))
    request = {"kind": "localize", "far": refs[0], "near": refs[1], "max_effort": "points"}
    job: dict[str, Any] = ended(server, server.post("/api/jobs", request))
    return job


def test_an_answer_names_its_expected_error_and_warns_of_an_outline_far_outside(
    page: Page, server: Server, known_pair: KnownPair, tmp_path: Path
) -> None:
    part, turned = known_pair.far[:, :256], np.rot90(known_pair.far)
    job = outcome(server, tmp_path, part, turned)
    assert job["found"]
    assert "40% of it lies inside" in job["warning"]
    page.open(f"#/localize/{job['id']}")
    page.wait(lambda: page.has("Expected error"))
    assert page.has("px in the mean, up to")
    assert page.find(".side .caution").text == job["warning"]
    assert not page.errors()


def test_a_mirrored_image_is_explained_in_the_table_and_on_the_page(
    page: Page, server: Server, known_pair: KnownPair, tmp_path: Path
) -> None:
    job = outcome(server, tmp_path, known_pair.far, known_pair.near[:, ::-1])
    assert job["explanation"].startswith("The near image is found once it is mirrored.")
    page.open(f"#/localize/{job['id']}")
    page.wait(lambda: page.has(job["explanation"]))


@pytest.mark.parametrize(("shift", "warned"), [(0, False), (60, False), (140, True)])
def test_only_outlines_mostly_outside_are_warned_of(shift: float, warned: bool) -> None:
    model = np.array([[1, 0, shift], [0, 1, 0], [0, 0, 1.0]])
    assert (warning(localized(BLANK, BLANK, model)) is not None) == warned


def test_every_kind_of_failure_has_a_plain_sentence() -> None:
    failed = replace(
        localized(BLANK, BLANK, np.eye(3), footprint=None, far_from_near=None),
        status="failed",
        reason="few",
    )
    said = {kind: explanation(replace(failed, failure=kind), Settings()) for kind in FAILURE_KINDS}
    assert len(set(said.values())) == len(FAILURE_KINDS)
    assert not any("--" in str(text) for text in said.values())
    assert "mirrored" in str(explanation(with_hint(failed), Settings()))
