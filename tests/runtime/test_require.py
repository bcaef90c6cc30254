"""A missing extra is named before any work is done."""

import importlib.util

import pytest

from nearfar.errors import MissingExtraError
from nearfar.runtime import require
from nearfar.runtime.workers import Workers


def test_a_missing_package_says_how_to_get_it() -> None:
    require("bench", "numpy")
    with pytest.raises(MissingExtraError, match=r"no_such_package: pip install 'nearfar\[bench\]'"):
        require("bench", "numpy", "no_such_package")


@pytest.mark.parametrize("extra", ["bench", "map"])
def test_local_processes_name_the_extra_of_their_work(
    monkeypatch: pytest.MonkeyPatch, extra: str
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "joblib" else found(name)
    )
    with pytest.raises(MissingExtraError, match=rf"joblib: pip install 'nearfar\[{extra}\]'"):
        list(Workers(2, extra=extra).run(str, [1], str))
