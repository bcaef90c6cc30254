"""`nearfar app` as a person starts it wrongly; tests/app has what it does when it is started."""

import os
from pathlib import Path

import pytest

from nearfar.cli import main
from tests.cli.test_localize import assert_bad_input, nearfar

pytest.importorskip("fastapi")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("missing",), "missing is not a folder"),
        (("--token-file", "short"), "at least 12 characters"),
        (("--token-file", "foreign"), "printable ASCII"),
        (("--token-file", "tab"), "printable ASCII"),
        (("--token-file", "absent"), "absent cannot be read"),
        (("--port", "70000"), "--port"),
        (("--max-pixels", "0"), "at least 1"),
    ],
)
def test_usage_errors(
    arguments: tuple[str, ...],
    word: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, token in (
        ("short", "short"),
        ("foreign", "пароль-пароль"),
        ("tab", "twelve\tletters"),
    ):
        Path(name).write_text(f"{token}\n", encoding="utf-8")
    assert main(["app", "--data", "data", *arguments]) == 2
    complaint = capsys.readouterr().err
    assert word in complaint
    assert complaint.count("\n") == 1


def test_a_folder_whose_name_is_no_text(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path) + b"/caf\xe9"
    os.mkdir(folder)  # noqa: PTH102
    assert_bad_input(nearfar("app", os.fsdecode(folder)), "not UTF-8")
