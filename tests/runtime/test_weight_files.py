"""Weights files: found and fetched; refused with one sentence where anything is wrong."""

import functools
import hashlib
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save

from nearfar.cli import main
from nearfar.errors import WeightsError
from nearfar.networks.weights import read_weights
from nearfar.runtime.weight_files import DOWNLOADS, cache_folder, fetch, weights_file
from nearfar.settings import Settings

TENSORS: dict[str, NDArray[Any]] = {"a": np.arange(6), "b": np.array([1, 2])}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("NEARFAR_CACHE", str(folder))
    return folder


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files; cuts those off whose name begins with "cut"."""

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Print nothing."""

    def end_headers(self) -> None:
        """Announce more than will come."""
        if "/cut" in self.path:
            self.send_header("Content-Length", "1000000")
        super().end_headers()


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A local server for the folder "served": its address."""
    monkeypatch.setenv("NO_PROXY", "*")
    (tmp_path / "served").mkdir()
    handler = functools.partial(QuietHandler, directory=str(tmp_path / "served"))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as http:
        threading.Thread(target=http.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{http.server_port}"
        http.shutdown()


@pytest.fixture
def served(tmp_path: Path, server: str) -> str:
    """The address of a weights file with its hash in the name."""
    content = save(TENSORS)
    name = f"resnet50-{hashlib.sha256(content).hexdigest()[:8]}.pth"
    (tmp_path / "served" / name).write_bytes(content)
    return f"{server}/{name}"


class TestFinding:
    def test_a_named_file_comes_first(self, cache: Path, tmp_path: Path) -> None:
        cache.mkdir()
        (cache / "resnet50-0676ba61.pth").touch()
        mine = tmp_path / "mine.pth"
        mine.touch()
        assert weights_file("resnet50", Settings(weights={"resnet50": mine})) == mine
        assert weights_file("resnet50", Settings()) == cache / "resnet50-0676ba61.pth"

    def test_a_named_file_is_never_replaced(self, cache: Path, tmp_path: Path) -> None:
        cache.mkdir()
        (cache / "resnet50-0676ba61.pth").touch()
        settings = Settings(weights={"resnet50": tmp_path / "none.pth"})
        with pytest.raises(WeightsError, match=r"none\.pth for resnet50 does not exist"):
            weights_file("resnet50", settings)

    @pytest.mark.usefixtures("cache")
    def test_where_there_is_none_the_message_says_how_to_get_it(self) -> None:
        with pytest.raises(WeightsError, match=r"--weights resnet50=FILE or .*fetch resnet50"):
            weights_file("resnet50", Settings())
        with pytest.raises(WeightsError, match=r"--weights squeezenet=FILE$"):
            weights_file("squeezenet", Settings())

    def test_the_home_folder_may_be_abbreviated(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("HOME", str(tmp_path))
        monkeypatch.setenv("USERPROFILE", str(tmp_path))
        (tmp_path / "mine.pth").touch()
        settings = Settings(weights={"squeezenet": Path("~/mine.pth")})
        assert weights_file("squeezenet", settings) == tmp_path / "mine.pth"

    @pytest.mark.parametrize("name", ["~no-such-user/mine.pth", "a" * 5000])
    def test_a_name_that_no_file_can_have_is_refused(self, name: str) -> None:
        with pytest.raises(WeightsError, match="for squeezenet"):
            weights_file("squeezenet", Settings(weights={"squeezenet": Path(name)}))


class RecordingBar:
    """Adds up what is reported."""

    def __init__(self) -> None:
        self.total = 0
        self.count = 0

    def update(self, count: int) -> None:
        self.count += count

    def reset(self) -> None:
        self.count = 0

    def close(self) -> None:
        """Nothing to close."""


class TestFetching:
    def test_the_file_is_kept_under_its_name(self, served: str, cache: Path) -> None:
        bar = RecordingBar()
        path = fetch("resnet50", bar, url=served)
        assert path == cache / served.rpartition("/")[2]
        assert list(cache.iterdir()) == [path]
        assert set(read_weights(path)) == set(TENSORS)
        assert bar.count == bar.total == path.stat().st_size

    def test_the_hash_may_be_at_the_end_of_the_url(
        self, server: str, cache: Path, tmp_path: Path
    ) -> None:
        (tmp_path / "served" / "net.onnx").write_bytes(b"network")
        digest = hashlib.sha256(b"network").hexdigest()
        path = fetch("aliked-onnx", url=f"{server}/net.onnx#sha256={digest}")
        assert path == cache / f"net-{digest}.onnx"
        other = digest[::-1]
        with pytest.raises(WeightsError, match="another SHA-256"):
            fetch("aliked-onnx", url=f"{server}/net.onnx#sha256={other}")
        assert list(cache.iterdir()) == [path]

    def test_what_is_there_is_not_fetched_again(
        self, served: str, cache: Path, tmp_path: Path
    ) -> None:
        path = fetch("resnet50", url=served)
        assert path.parent == cache
        (tmp_path / "served" / path.name).unlink()
        assert fetch("resnet50", url=served) == path

    def test_a_damaged_file_is_fetched_again(self, served: str, cache: Path) -> None:
        path = cache / served.rpartition("/")[2]
        cache.mkdir()
        path.write_bytes(b"damaged")
        assert set(read_weights(fetch("resnet50", url=served))) == set(TENSORS)

    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("resnet50-0676ba61.pth", "another SHA-256 than its name says"),
            ("resnet50-.pth", "another SHA-256 than its name says"),
            ("cut-0676ba61.pth", "cannot download"),
            ("none-0676ba61.pth", "cannot download"),
        ],
        ids=["other content", "no hash", "cut off", "not there"],
    )
    def test_nothing_is_left_of_a_failed_download(
        self, name: str, message: str, server: str, cache: Path, tmp_path: Path
    ) -> None:
        if not name.startswith("none"):
            (tmp_path / "served" / name).write_bytes(b"other content")
        with pytest.raises(WeightsError, match=message):
            fetch("resnet50", url=f"{server}/{name}")
        assert list(cache.iterdir()) == []

    @pytest.mark.usefixtures("cache")
    def test_no_connection_is_one_sentence(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("NO_PROXY", "*")
        with pytest.raises(WeightsError, match=r"^cannot download http://\S+ to \S+: \w+$"):
            fetch("resnet50", url="http://127.0.0.1:9/resnet50-0676ba61.pth")

    def test_a_cache_that_cannot_be_written_is_one_sentence(self, served: str, cache: Path) -> None:
        cache.touch()
        with pytest.raises(WeightsError, match="cannot download"):
            fetch("resnet50", url=served)

    def test_a_network_without_a_source_is_refused(self) -> None:
        with pytest.raises(WeightsError, match="'squeezenet' cannot be fetched"):
            fetch("squeezenet")

    def test_the_cache_folder_has_a_default(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delenv("NEARFAR_CACHE", raising=False)
        assert "nearfar" in str(cache_folder())


class TestCommand:
    def test_fetch_then_show(
        self,
        served: str,
        cache: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        monkeypatch.setitem(DOWNLOADS, "resnet50", served)
        path = cache / served.rpartition("/")[2]
        assert main(["weights", "fetch", "resnet50"]) == 0
        assert capsys.readouterr().out == f"{path}\n"
        assert main(["weights", "show"]) == 0
        shown = capsys.readouterr().out.splitlines()
        assert shown[0] == "nearfar: comes with the package"
        assert shown[1] == f"resnet50: {path}"
        assert shown[-1].endswith("or run `nearfar weights fetch aliked-lightglue-onnx`")
        assert "--weights squeezenet=FILE" in shown[2]

    def test_a_failure_is_one_line(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["weights", "fetch", "alexnet"]) == 2
        error = capsys.readouterr().err
        assert error.startswith("nearfar: weights of 'alexnet' cannot be fetched")
        assert error.count("\n") == 1
