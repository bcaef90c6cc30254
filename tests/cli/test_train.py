import hashlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nearfar.arrays import RGBPixels
from nearfar.cli import main
from nearfar.descriptors import DESCRIPTORS
from nearfar.settings import Settings
from nearfar.storage.rows import read_rows


def test_trains_a_descriptor_that_can_be_used(
    photograph: Callable[[str], RGBPixels], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    photographs, out = tmp_path / "photo graphs é", tmp_path / "out"
    photographs.mkdir()
    for name in ("astronaut", "coffee", "chelsea"):
        Image.fromarray(photograph(name)).save(photographs / f"{name}.png")
    large = Image.fromarray(photograph("coffee")).resize((2400, 1600))
    large.save(photographs / "coffee.png")  # OpenCV reduces it with threads; see training.py.
    (photographs / "broken.jpg").write_bytes(b"\xff\xd8")
    command = ["train", "descriptor", str(photographs), "--out", str(out), "--small"]
    assert main([*command, "--steps", "2", "--jobs", "0"]) == 0
    said = capsys.readouterr().out
    model = out / "landmark_network.onnx"
    assert "broken.jpg" in said
    assert hashlib.sha256(model.read_bytes()).hexdigest() in said
    assert (out / "learning_curves.png").stat().st_size > 0
    descriptor = DESCRIPTORS.create("nearfar", Settings(weights={"nearfar": model}))
    boxes = np.array([[0, 0, 100, 80]], np.int32)
    length = np.linalg.norm(descriptor.describe(photograph("coffee"), boxes).astype(float))
    assert abs(length - 1) < 1e-2
    by_processes = [*command[:-2], str(tmp_path / "other"), command[-1], "--steps", "2"]
    nearfar = [sys.executable, "-m", "nearfar"]
    subprocess.run([*nearfar, *by_processes, "--jobs", "1"], check=True, timeout=120)
    logs = (read_rows(folder / "log.jsonl") for folder in (out, tmp_path / "other"))
    for one, other in zip(*logs, strict=True):
        assert one["landmark_loss"] == pytest.approx(other["landmark_loss"], rel=1e-3)
    assert main([*command, "--steps", "3"]) == 2
    assert "another folder" in capsys.readouterr().err


def test_without_torch_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["train", "descriptor", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "pip install 'nearfar[train]'" in capsys.readouterr().err
