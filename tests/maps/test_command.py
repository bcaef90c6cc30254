"""`nearfar map` as a person calls it: output, exit status, one line for each error."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.cli import main
from tests.cli.test_localize import assert_bad_input, nearfar
from tests.conftest import KnownPair
from tests.maps.conftest import write


@pytest.fixture
def queries(
    close_up: KnownPair, pictures: Callable[[str], RGBPixels], tmp_path: Path
) -> tuple[Path, Path]:
    """A close-up that the map shows, and a photograph that it does not."""
    found = write(tmp_path / "queries" / "vu é [bold].png", close_up.near)
    return found, write(tmp_path / "queries" / "unknown.png", pictures("retina")[400:900, 400:900])


def test_from_images_to_a_location(
    photos: Path,
    queries: tuple[Path, Path],
    close_up: KnownPair,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def said(*arguments: object) -> str:
        assert main(["map", *map(str, arguments)]) == 0
        return capsys.readouterr().out

    write(photos / "astronaut.png", close_up.far)
    (photos / "broken.png").write_bytes(b"broken")
    map_, out = tmp_path / "town map", tmp_path / "out"
    built = nearfar("map", "build", photos / "astronaut.png", photos / "broken.png", "--out", map_)
    assert built.returncode == 0, built.stderr
    assert "1 added, 0 replaced, 0 unchanged, 1 left out" in built.stdout
    assert "photos/broken.png" in built.stdout
    assert built.stderr == ""
    assert "2 added" in said("add", map_, photos / "coffee.png", photos / "coins.png")
    assert said("remove", map_, "photos/broken.png", photos / "coins.png") == "2 removed\n"
    assert said("check", map_) == "2 images, no problem\n"
    assert "photos/astronaut.png: confidence" in said("locate", map_, queries[0], "--save", out)
    assert sorted(file.name for file in out.iterdir()) == ["vu é [bold].json", "vu é [bold].png"]
    saved = json.loads((out / "vu é [bold].json").read_text())
    assert close_up.error(np.array(saved["answers"][0]["far_from_near"]["homography"])) < 2
    assert said("compact", map_) == "compacted\n"


def test_json_lines_and_nothing_else(map_: Path, queries: tuple[Path, Path]) -> None:
    result = nearfar(
        "map", "locate", map_, *queries, "--json", "--max-effort", "points", "--candidates", 2
    )
    assert result.returncode == 3, result.stderr
    assert result.stderr == ""
    found, unknown = map(json.loads, result.stdout.splitlines())
    keys = {
        *("status", "reason", "failure", "query", "prior", "answers", "world", "candidates"),
        "seconds",
    }
    assert set(found) == set(unknown) == keys
    assert (found["status"], found["reason"]) == ("located", None)
    assert found["query"] == {"path": str(queries[0]), "width": 480, "height": 420}
    (answer,) = found["answers"]
    assert set(answer) == {
        "image", "far_from_near", "footprint", "scale_change", "confidence", "votes", "world",
        "alternatives", "expected_error", "taken",
    }  # fmt: skip
    assert np.array(answer["far_from_near"]["homography"]).shape == (3, 3)
    assert np.array(answer["footprint"]).shape == (4, 2)
    assert 0.5 <= answer["confidence"] <= 1
    assert (unknown["status"], unknown["answers"]) == ("not found", [])
    assert unknown["reason"]
    assert len(unknown["candidates"]) == 4, "two as it is and two seen from aside"
    assert set(unknown["candidates"][0]) == {
        "image", "votes", "confidence", "reason", "failure", "place"
    }  # fmt: skip


def test_info(map_: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", "info", str(map_)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("8 images, ")
    assert "photos/coins.png: 384x303, " in said
    assert main(["map", "info", str(map_), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["format"], content["descriptor"], content["max_size"]) == (2, "nearfar", 0)
    assert len(content["images"]) == 8


def test_problems_are_told(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(photos.parent / "map")
    assert main(["map", "build", str(photos / "coins.png"), "--out", folder]) == 0
    (photos / "coins.png").unlink()
    capsys.readouterr()
    assert main(["map", "check", folder]) == 3
    assert capsys.readouterr().out == "photos/coins.png: the file is missing\n"


def test_one_query_that_cannot_be_read_does_not_stop_the_others(
    map_: Path, queries: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "missing.png"
    options = ["--json", "--max-effort", "points"]
    assert main(["map", "locate", str(map_), str(missing), str(queries[0]), *options]) == 2
    said = capsys.readouterr()
    assert json.loads(said.out)["status"] == "located"
    assert said.err == f"nearfar: {missing} does not exist\n"


def test_folders_and_lists_of_queries(
    small_town: Path, small_close_up: KnownPair, tmp_path: Path
) -> None:
    folder, listed = tmp_path / "queries", tmp_path / "list.txt"
    write(folder / "a.png", small_close_up.near)
    write(folder / ".hidden.png", small_close_up.near)
    write(tmp_path / "b.png", small_close_up.near)
    listed.write_text("# queries\n\nb.png\nqueries/a.png\n")
    result = nearfar("map", "locate", small_town, folder, "--list", listed, "--json")
    assert result.returncode == 0, result.stderr
    paths = [json.loads(line)["query"]["path"] for line in result.stdout.splitlines()]
    assert paths == [str(folder / "a.png"), str(tmp_path / "b.png")]
    assert_bad_input(nearfar("map", "locate", small_town), "--list FILE")
    assert_bad_input(nearfar("map", "locate", small_town, "--list", tmp_path / "no"), "no")
    (tmp_path / "empty").mkdir()
    assert_bad_input(nearfar("map", "locate", small_town, tmp_path / "empty"), "no images")


def test_a_missing_file_of_the_map_is_bad_input(
    photos: Path, small_close_up: KnownPair, tmp_path: Path
) -> None:
    folder, query = photos.parent / "map", write(tmp_path / "query.png", small_close_up.near)
    assert nearfar("map", "build", photos / "astronaut.png", "--out", folder).returncode == 0
    (photos / "astronaut.png").unlink()
    result = nearfar("map", "locate", folder, query)
    assert result.returncode == 2
    assert "not found" in result.stdout
    assert result.stderr == (
        "nearfar: the file photos/astronaut.png is missing or has changed: build the map again\n"
    )


def test_queries_of_one_name_are_saved_apart(map_: Path, tmp_path: Path) -> None:
    others = [write(tmp_path / place / "a.png", np.zeros((9, 9, 3), np.uint8)) for place in "bc"]
    assert main(["map", "locate", str(map_), *map(str, others), "--save", str(tmp_path / "o")]) == 3
    assert sorted(file.name for file in (tmp_path / "o").iterdir()) == ["a-2.json", "a.json"]


def test_bad_input(
    map_: Path,
    queries: tuple[Path, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert_bad_input(nearfar("map", "info", tmp_path / "no map"), "no map", "nearfar map build")
    for arguments, word in (
        (["build", tmp_path / "no", "--out", tmp_path / "m"], "exist"),
        (["build", queries[0], "--out", map_, "--max-size", 500], "max_size"),
        (["remove", map_, "no such image"], "no such image"),
        (["locate", map_, queries[0], "--top", 0], "at least 1"),
    ):
        assert main(["map", *map(str, arguments)]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert word in said.err
        assert len(said.err.splitlines()) == 1


def test_help(capsys: pytest.CaptureFixture[str]) -> None:
    main(["map", "locate", "--help"])
    assert "MAP" in capsys.readouterr().out


def test_without_the_extra_says_what_to_install(
    map_: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    monkeypatch.setitem(sys.modules, "lancedb", None)
    assert main(["map", "info", str(map_)]) == 2
    assert "pip install 'nearfar[map]'" in capsys.readouterr().err


def test_a_matcher_of_the_users_verifies_candidates(
    small_town: Path, queries: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is asked where SIFT refuses, here the query that is not in the map."""
    (tmp_path / "mine_in_maps.py").write_text(
        "import numpy as np\n"
        "calls = []\n"
        "def match(far, near):\n"
        "    calls.append(near.shape)\n"
        "    return np.empty((0, 2)), np.empty((0, 2))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    options = ["--candidates", 1, "--max-effort", "landmarks"]
    result = nearfar(
        "map", "locate", small_town, queries[1], *options, "--matcher", "python:mine_in_maps.match"
    )
    assert result.returncode == 3, result.stderr
    assert sys.modules["mine_in_maps"].calls
    assert_bad_input(
        nearfar("map", "locate", small_town, queries[1], "--device", "abacus"), "device"
    )
