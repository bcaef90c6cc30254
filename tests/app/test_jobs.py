"""Jobs on disk."""

import logging
from pathlib import Path

import pytest

from nearfar.app.jobs import JobStore, LocalizeRequest


def test_jobs_of_another_version_are_left_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    known = JobStore(tmp_path, 2).create(LocalizeRequest(kind="localize", far="a", near="b"), ())
    other = tmp_path / "0123456789abcdef"
    other.mkdir()
    content = {"job.json": '{"id": "0123456789abcdef", "colour": "red"}', "result.json": "{}"}
    for name, text in content.items():
        (other / name).write_text(text)
    (tmp_path / "fedcba9876543210").mkdir()
    with caplog.at_level(logging.WARNING, "nearfar"):
        store = JobStore(tmp_path, 2)
    assert [job.id for job in store.all()] == [known.id]
    assert {file.name: file.read_text() for file in other.iterdir()} == content
    left = {record.getMessage().split()[2] for record in caplog.records}
    assert left == {"0123456789abcdef", "fedcba9876543210"}
    for _ in range(3):  # They take no room of other jobs, and are not removed to make some.
        store.create(known.request, ())
    assert other.is_dir()


def test_a_job_that_an_older_version_calls_failed_is_an_error(tmp_path: Path) -> None:
    known = JobStore(tmp_path, 2).create(LocalizeRequest(kind="localize", far="a", near="b"), ())
    file = tmp_path / known.id / "job.json"
    file.write_text(file.read_text().replace('"waiting"', '"failed"'))
    (job,) = JobStore(tmp_path, 2).all()
    assert job.status == job.outcome == "error"
