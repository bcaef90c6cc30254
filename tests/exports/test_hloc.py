"""hloc's files, read as hloc reads them."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PillowImage

import nearfar
from nearfar import ExportError, Image, ImageInfo, Localization
from nearfar.adapters.hloc import match_pairs
from nearfar.exports.hloc import NamedLocalization, names_to_pair
from tests.conftest import KnownPair

h5py = pytest.importorskip("h5py")


def list_names(path: Path) -> set[str]:
    """As `list_h5_names` of hloc's utils/io.py: the groups that hold arrays."""
    names = set()

    def visit(_: str, each: Any) -> None:
        if isinstance(each, h5py.Dataset):
            names.add(each.parent.name.strip("/"))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return names


def matched(features: Path, matches: Path, name0: str, name1: str) -> tuple[np.ndarray, ...]:
    """Matched points of both images and scores, as hloc's `get_matches` finds them."""
    with h5py.File(matches, "r") as file:
        group = file[names_to_pair(name0, name1)]
        matches0, scores = group["matches0"][()], group["matching_scores0"][()]
    index = np.flatnonzero(matches0 != -1)
    with h5py.File(features, "r") as file:
        keypoints = [file[name]["keypoints"][()] for name in (name0, name1)]
    assert len(matches0) == len(keypoints[0])
    return keypoints[0][index], keypoints[1][matches0[index]], scores[index]


def rows(*arrays: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(row) for row in np.hstack(arrays).astype(np.float32).tolist()}


def test_features_and_matches(found: Localization, tmp_path: Path) -> None:
    features, matches, pairs = nearfar.export(found, "hloc", tmp_path / "hloc")
    assert pairs.read_text(encoding="utf-8") == "near.png maps/far.png\n"
    assert list_names(features) == {"near.png", "maps/far.png"}
    assert list_names(matches) == {"near.png/maps-far.png"}
    near, far, scores = matched(features, matches, "near.png", "maps/far.png")
    points = found.points
    assert rows(near, far) <= rows(points.near, points.far)
    inliers = scores == 1
    right = points.inliers
    assert rows(near[inliers], far[inliers]) == rows(points.near[right], points.far[right])
    assert len(near) == len(points) - 4  # Two in each image would use a keypoint again.
    with h5py.File(features, "r") as file:
        assert file["maps/far.png"]["image_size"][()].tolist() == [480, 360]
        assert file["near.png"]["keypoints"].dtype == np.float32


def test_a_failure_has_matches_and_no_inliers(failed: Localization, tmp_path: Path) -> None:
    features, matches, _ = nearfar.export(failed, "hloc", tmp_path / "hloc")
    _, _, scores = matched(features, matches, "near.png", "maps/far.png")
    assert len(scores) > 0
    assert not scores.any()


def test_points_that_are_not_finite_are_left_out(found: Localization, tmp_path: Path) -> None:
    far = found.points.far.copy()
    far[10] = np.nan
    broken = replace(found, points=replace(found.points, far=far))
    features, matches, _ = nearfar.export(broken, "hloc", tmp_path / "hloc")
    near, far, _ = matched(features, matches, "near.png", "maps/far.png")
    assert np.isfinite(far).all()
    assert len(near) == len(found.points) - 5


def test_nearfar_in_the_place_of_match_dense(known_pair: KnownPair, tmp_path: Path) -> None:
    for name, pixels in (("map/far.png", known_pair.far), ("near.png", known_pair.near)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        PillowImage.fromarray(pixels).save(tmp_path / name)
    half = known_pair.near[:300]
    PillowImage.fromarray(np.ascontiguousarray(half)).save(tmp_path / "half.png")
    pairs = tmp_path / "pairs.txt"
    pairs.write_text("near.png map/far.png\n\nhalf.png map/far.png\nmap/far.png near.png\n")
    features, matches = match_pairs(
        pairs, tmp_path, tmp_path / "f.h5", tmp_path / "m.h5", model="homography", method="sift"
    )
    assert list_names(matches) == {"near.png/map-far.png", "half.png/map-far.png"}
    for name in ("near.png", "half.png"):
        near, far, scores = matched(features, matches, name, "map/far.png")
        truth = known_pair.far_from_near @ np.column_stack([near, np.ones(len(near))]).T
        error = np.linalg.norm(truth[:2].T / truth[2:].T - far, axis=1)
        assert (scores == 1).sum() >= 20
        assert np.median(error[scores == 1]) < 2


def test_the_pixels_of_a_list_are_not_kept(
    known_files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[NamedLocalization] = []
    monkeypatch.setattr(
        "nearfar.adapters.hloc.write_hloc", lambda found, *_files: kept.extend(found)
    )
    far, near = known_files
    pairs = tmp_path / "pairs.txt"
    pairs.write_text(f"{near.name} {far.name}\n")
    match_pairs(pairs, far.parent, tmp_path / "f.h5", tmp_path / "m.h5", method="sift")
    (found,) = (each.localization for each in kept)
    assert found.far == ImageInfo(far, 640, 480, (640, 480))
    assert not any(isinstance(each, Image) for each in vars(found).values())


def test_names_that_hlocs_lists_cannot_hold_are_refused(
    found: Localization, tmp_path: Path
) -> None:
    with pytest.raises(ExportError, match="white space"):
        nearfar.export(found, "hloc", tmp_path / "hloc", far="far 1.png", near="near.png")
    assert not (tmp_path / "hloc").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="names are text elsewhere")
def test_names_that_are_not_utf8_are_refused(
    found: Localization, images: tuple[Path, Path], tmp_path: Path
) -> None:
    assert found.near.path == images[1]
    path = images[1].rename(images[1].with_name("\udcff.png"))
    odd = replace(found, near=replace(found.near, path=path))
    for name in ("hloc", "colmap"):
        pytest.importorskip("pycolmap" if name == "colmap" else "h5py")
        with pytest.raises(ExportError, match=r"'\\udcff.png', a name that is not UTF-8"):
            nearfar.export(odd, name, tmp_path / "out")
        assert not (tmp_path / "out").exists()
        nearfar.export(odd, name, tmp_path / f"{name} \udcff", far="far.png", near="near.png")


def test_a_list_that_is_no_list_of_pairs(tmp_path: Path) -> None:
    pairs = tmp_path / "pairs.txt"
    pairs.write_text("only-one.png\n")
    with pytest.raises(ExportError, match="two names of images a line"):
        match_pairs(pairs, tmp_path, tmp_path / "f.h5", tmp_path / "m.h5")


def test_a_damaged_image_does_not_lose_the_list(
    known_files: tuple[Path, Path], tmp_path: Path
) -> None:
    _, near = known_files
    (tmp_path / "damaged.png").write_bytes(near.read_bytes()[:300])
    pairs = tmp_path / "pairs.txt"
    pairs.write_text("damaged.png far.png\nnear.png far.png\n")
    files = tmp_path / "f.h5", tmp_path / "m.h5"
    features, matches = match_pairs(pairs, tmp_path, *files, method="sift")
    assert list_names(matches) == {"near.png/far.png"}
    assert list_names(features) == {"near.png", "far.png"}
    failed, kept = tmp_path / "m-failed.txt", tmp_path / "m-pairs.txt"
    assert failed.read_text().startswith("damaged.png far.png ")
    assert "damaged.png cannot be read" in failed.read_text()
    assert kept.read_text() == "near.png far.png\n"
    pairs.write_text("near.png far.png\n")
    match_pairs(pairs, tmp_path, *files, method="sift")
    assert not failed.exists()
    assert not kept.exists()
    pairs.write_text("damaged.png far.png\n")
    with pytest.raises(ExportError, match=r"no pair .*damaged.png"):
        match_pairs(pairs, tmp_path, *files, method="sift")
