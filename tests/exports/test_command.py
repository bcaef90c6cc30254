"""`nearfar localize --export` and `nearfar about`."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar.cli import main
from nearfar.cli.about_command import Component, components, licence

Files = tuple[Path, Path]


def test_exports_lie_beside_what_is_saved(
    known_files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far, near = map(str, known_files)
    out = tmp_path / "result"
    exports = ["--export", "csv", "--export", "geojson", "--export", "csv"]
    status = main(["localize", far, near, "--method", "sift", "--save", str(out), *exports])
    assert status == 0
    printed = capsys.readouterr().out
    for name in ("localization.json", "matches.csv", "footprint.geojson"):
        assert (out / name).is_file()
        assert printed.count(f"saved {out / name}\n") == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--export", "csv"], "--save DIR"),
        (["--save", "x", "--export", "cvs"], "'cvs'; there are colmap, csv"),
        (["--save", "x", "--export", "kitti"], "is a homography"),
    ],
)
def test_what_cannot_be_exported_is_one_line(
    options: list[str],
    words: str,
    known_files: Files,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    far, near = map(str, known_files)
    assert main(["localize", far, near, "--method", "sift", *options]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1


def test_a_format_that_fails_does_not_stop_the_others(
    known_files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far, near = map(str, known_files)
    out = tmp_path / "result"
    (out / "localization.yaml").mkdir(parents=True)
    formats = ["--export", "kitti", "--export", "opencv-yaml", "--export", "csv"]
    status = main(["localize", far, near, "--method", "sift", "--save", str(out), *formats])
    said = capsys.readouterr()
    assert status == 2
    assert said.out.startswith("localized: ")
    assert (out / "matches.csv").is_file()
    kitti, yaml = said.err.splitlines()
    assert "not exported as kitti: the localization is a homography" in kitti
    assert "not exported as opencv-yaml: " in yaml
    assert str(out) in yaml


def test_a_failure_stays_an_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blank = tmp_path / "blank.png"
    PillowImage.fromarray(np.zeros((60, 80, 3), np.uint8)).save(blank)
    exports = ["--export", "geojson", "--export", "csv"]
    arguments = ["localize", str(blank), str(blank), "--method", "sift", "--save", str(tmp_path)]
    assert main([*arguments, *exports]) == 3
    assert "not exported as geojson: the localization failed" in capsys.readouterr().err
    assert (tmp_path / "matches.csv").read_text().splitlines() == [
        "far_x,far_y,near_x,near_y,inlier"
    ]


def test_components_and_the_extras_that_need_them() -> None:
    found = components(
        [
            "numpy>=2.0",
            "no-such-package>=1; extra == 'export'",
            'numpy ; extra == "export"',
            "nearfar[map] ; extra == 'geo'",
        ]
    )
    assert found[0] == Component("no-such-package", None, None, ("export",))
    assert (found[1].name, found[1].extras) == ("numpy", ("always", "export"))
    assert found[1].version == importlib.metadata.version("numpy")
    assert len(found) == 2


def test_licences_are_names_and_not_texts() -> None:
    assert "BSD" in licence(importlib.metadata.metadata("scipy"))
    assert "\n" not in licence(importlib.metadata.metadata("scipy"))
    assert licence(importlib.metadata.metadata("cachetools")) == "MIT"


def test_about(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["about"]) == 0
    printed = capsys.readouterr().out
    for words in ("nearfar 0", "Apache-2.0", "onnxruntime", "squeezenet", "extra"):
        assert words in printed
    assert printed.index("extra") < printed.index("model") < printed.index("component")
