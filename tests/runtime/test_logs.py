import json
import logging

import pytest

from nearfar.runtime import logs
from nearfar.runtime.logs import shown_progress
from nearfar.runtime.timing import Meter, Work, this_worker


@pytest.fixture(autouse=True)
def as_before() -> object:
    yield
    logging.getLogger("nearfar").handlers = []
    logging.getLogger("nearfar").setLevel(logging.NOTSET)


def test_json_lines(capsys: pytest.CaptureFixture[str]) -> None:
    logs.start("json")
    logs.event("run started", todo=3)
    with shown_progress("pairs") as show:
        for done in range(4):
            show(done, 3)
    logging.getLogger("nearfar.some.module").warning("left %s", "out")
    said = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [(each["event"], each.get("done")) for each in said] == [
        ("run started", None),
        ("progress", 0),
        ("progress", 3),
        ("left out", None),
    ]
    assert said[0]["todo"] == 3
    assert {each["level"] for each in said} == {"info", "warning"}
    assert all(each["time"].endswith("+00:00") for each in said)


def test_text_tells_warnings_alone(capsys: pytest.CaptureFixture[str]) -> None:
    logs.start("text")
    logs.event("run started", todo=3)
    logs.event("worker died", logging.WARNING, task=7)
    assert capsys.readouterr().err == "nearfar: worker died\n"


def test_metrics() -> None:
    meter = Meter(skipped=2)
    meter.finished(Work(this_worker(), 100.0))
    meter.finished(Work("elsewhere/7", 5.0))
    meter.failed += 1
    found = meter.metrics()
    assert (found.done, found.failed, found.skipped, found.workers) == (2, 1, 2, 2)
    assert 5.0 <= found.cpu_seconds < 20.0
    assert set(found.to_dict()) >= {"wall_seconds", "retried"}


class FullDisk:
    def write(self, _: str) -> None:
        raise OSError(28, "No space left on device")


def test_a_full_disk_does_not_end_what_is_logged(monkeypatch: pytest.MonkeyPatch) -> None:
    logs.start("json")
    monkeypatch.setattr("sys.stderr", FullDisk())
    logs.event("run started")
