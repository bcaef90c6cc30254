"""What an answer offers beside itself: other places, epipolar lines, and what may help."""

from pathlib import Path
from typing import get_args

import cv2
import numpy as np
from PIL import Image

from nearfar.app.choices import MatcherName, matchers
from nearfar.features import MATCHERS
from tests.app.browser import ImageView, Page
from tests.app.conftest import Server
from tests.app.test_api import ended
from tests.conftest import KnownPair

Files = tuple[Path, Path]


def test_every_matcher_that_is_offered_exists_or_says_what_it_lacks() -> None:
    assert set(get_args(MatcherName)) <= set(MATCHERS.names())
    offered = {each.name: each.missing for each in matchers()}
    assert offered["sift"] is None
    for name, missing in offered.items():
        assert missing is None or ("install" in missing or "--weights" in missing), name


def test_a_failure_is_tried_again_with_swapped_roles_by_one_click(
    page: Page, server: Server, served: Path
) -> None:
    refs = []
    for shade in (40, 80):
        file = served / f"flat-{shade}.png"
        Image.fromarray(np.full((120, 160, 3), shade, np.uint8)).save(file)
        refs.append(server.ref(file))
    request = {"kind": "localize", "far": refs[0], "near": refs[1], "max_effort": "points"}
    job = ended(
        server, server.post("/api/jobs", request | {"near_mask": [[[0, 0], [9, 0], [9, 9]]]})
    )
    page.open(f"#/localize/{job['id']}")
    page.wait(lambda: page.has("What may help"))
    for text in ("As a scene with depth", "Try everything"):
        assert page.has(text)
    page.push("Swap far and near", "aside")
    page.wait(lambda: job["id"] not in page.driver.current_url and page.has("Not found"))
    again = server.get(f"/api/jobs/{page.driver.current_url.rpartition('/')[2]}")["request"]
    assert [again["far"], again["near"]] == refs[::-1]
    assert len(again["far_mask"]) == 1
    assert not again["near_mask"]
    assert not page.errors()


def test_an_epipolar_geometry_is_shown_by_lines_through_the_matches(
    page: Page, server: Server, files: Files, known_pair: KnownPair
) -> None:
    far, near = (server.ref(file) for file in files)
    page.open("#/localize")
    page.find("#localize")
    homography = known_pair.far_from_near
    epipole = np.array([300.0, 200.0, 1.0])
    cross = np.cross(np.eye(3), epipole) * -1
    fundamental = cross @ homography  # far·F·near = 0 for matches of the homography.
    distance, line = page.driver.execute_async_script(
        """
        const [far, near, fundamental, homography, done] = arguments;
        const load = (name) => import(`/static/js/${name}.js`);
        Promise.all(["pair-viewer", "epipolar", "geometry"].map(load)).then(
          async ([{ PairViewer }, { epipolarError, epipolarLine }, { transform }]) => {
            const viewer = new PairViewer(), at = [100, 120], place = transform(homography, at);
            document.querySelector("main").replaceChildren(viewer.element);
            const step = { name: "points", far: [place], near: [at], inliers: [1], answer: true };
            await viewer.show({ far, near, homography: null, fundamental, steps: [step],
              landmarks: [], scaleChange: null });
            done([epipolarError(fundamental, place, at), epipolarLine(fundamental, "near", place)]);
          });
        """,
        far, near, fundamental.tolist(), homography.tolist(),
    )  # fmt: skip
    assert abs(distance) < 1e-6
    assert abs(np.dot(line, [100, 120, 1])) < 1e-6
    assert page.has("Epipolar lines")
    view = ImageView(page, 0)
    place = (homography @ [100, 120, 1])[:2] / (homography @ [100, 120, 1])[2]
    along = place + 0.5 * (epipole[:2] - place)  # The line goes on to the epipole.
    x, y = np.rint(view.place(along)).astype(int)
    seen = view.pixels()[y - 2 : y + 3, x - 2 : x + 3, :3].astype(int)
    page.click("[data-layer=epipolar]")
    hidden = view.transform() and view.pixels()[y - 2 : y + 3, x - 2 : x + 3, :3].astype(int)
    assert np.abs(seen - hidden).max() > 25
    assert not page.errors()


def test_a_pose_is_told_in_words(page: Page) -> None:
    page.open("#/localize")
    page.find("#localize")
    turned, _ = cv2.Rodrigues(np.array([0.0, np.radians(12), 0]))  # y points down.
    rolled, _ = cv2.Rodrigues(np.array([0.0, 0, np.radians(5)]))
    raised, _ = cv2.Rodrigues(np.array([np.radians(7), 0, 0]))
    words = page.driver.execute_async_script(
        """
        const [rotations, directions, done] = arguments;
        import("/static/js/pose-words.js").then(({ turnInWords, directionInWords }) =>
          done([...rotations.map(turnInWords), ...directions.map(directionInWords)]));
        """,
        [each.tolist() for each in (turned, rolled, raised, np.eye(3), turned @ rolled)],
        [[0.6, 0, 0.8], [0, -1, -1]],
    )
    assert words == [
        "12.0° to the right", "5.0° clockwise", "7.0° up", "not turned",
        "12.0° to the right, 5.0° clockwise", "ahead, 36.9° to the right", "behind, 45.0° up",
    ]  # fmt: skip


def test_cameras_are_taken_from_what_is_typed(page: Page, server: Server, files: Files) -> None:
    page.open("#/localize")
    page.find("#localize")
    page.choose(files)
    pose = page.find("#model option[value=pose]")
    assert not pose.is_enabled()
    page.click("details.more-options summary")
    page.find("#camera option[value=given]").click()
    page.find("#camera-text").send_keys("/etc/passwd")
    page.find("#effort option[value=points]").click()
    page.click("#localize")
    page.wait(lambda: page.has("no camera file of COLMAP"))
    page.find("#camera-text").clear()
    page.find("#camera-text").send_keys("PINHOLE:700,700,320,240")
    assert pose.is_enabled()
    page.click("#localize")
    page.wait(lambda: page.has("Focal length, near"))
    request = server.get(f"/api/jobs/{page.driver.current_url.rpartition('/')[2]}")["request"]
    assert request["far_camera"] == request["near_camera"] == "PINHOLE:700,700,320,240"
    assert page.has("700 px, given")
    assert len(page.errors()) == 1  # The request that was refused.
