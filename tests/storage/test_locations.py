"""Files of object storage, and what is said where it fails."""

from pathlib import Path

import pytest

from nearfar.errors import StorageError
from nearfar.storage.locations import FileState, Url, local_copy, location, staged, storage_errors
from tests.object_storage import KEY, SECRET, Server


def test_places_are_named(tmp_path: Path) -> None:
    assert location(tmp_path) == tmp_path
    assert location("s3://some.bucket//a/b/") == Url("some.bucket", "a/b")
    url = Url("bucket", "a/b.tar.gz")
    assert (url.name, url.stem, url.suffix) == ("b.tar.gz", "b.tar", ".gz")
    assert (url.parent, url.parent.parent) == (Url("bucket", "a"), Url("bucket", ""))
    assert url.parent / "c" == Url("bucket", "a/c")
    assert [str(each) for each in (url, Url("bucket", ""))] == [
        "s3://bucket/a/b.tar.gz",
        "s3://bucket",
    ]


def test_a_url_never_holds_credentials() -> None:
    for text in (f"s3://{KEY}:{SECRET}@bucket/map", "s3:///map", "s3://"):
        with pytest.raises(StorageError, match="environment") as caught:
            location(text)
        assert SECRET not in str(caught.value)
    with pytest.raises(StorageError, match="ftp"):
        location("ftp://server/map")


def test_files(bucket: Url, monkeypatch: pytest.MonkeyPatch) -> None:
    file = bucket / "folder" / "file.txt"
    assert not file.exists()
    with pytest.raises(FileNotFoundError):
        file.read_bytes()
    file.write_text("é")
    assert (file.exists(), file.read_text(), file.parent.is_dir()) == (True, "é", True)
    assert not file.parent.is_file()
    (listed,) = bucket.below()
    assert (listed, listed.listed) == (file, file.state())
    assert file.state().size == 2
    assert file.state() != FileState(2, 0)
    large = bucket / "large"
    large.write_bytes(bytes(range(256)) * 50_000)
    with monkeypatch.context() as context:
        context.setattr(Url, "read_bytes", None)  # It would hold all in memory.
        with local_copy(large) as copy:
            assert copy.read_bytes() == bytes(range(256)) * 50_000
    large.unlink()
    with local_copy(file) as copy:
        assert (copy.name, copy.read_text()) == ("file.txt", "é")
    assert not copy.exists()
    file.unlink()
    file.unlink()
    assert list(bucket.below()) == []


def test_conditional_writes(bucket: Url) -> None:
    file = bucket / "lock"
    file.create(b"first")
    with pytest.raises(FileExistsError):
        file.create(b"second")
    content, version = file.read_version()
    assert content == b"first"
    file.replace_version(b"third", version)
    with pytest.raises(FileExistsError):
        file.replace_version(b"fourth", version)
    assert file.read_bytes() == b"third"


def test_new_files_are_sent_at_the_end(bucket: Url, tmp_path: Path) -> None:
    with staged(bucket / "out") as folder:
        (folder / "below").mkdir()
        (folder / "below" / "a.txt").write_text("a")
    assert (bucket / "out" / "below" / "a.txt").read_text() == "a"
    with staged(tmp_path / "out") as folder:
        assert folder == tmp_path / "out"


def test_a_server_that_does_not_answer_is_named(server: Server) -> None:
    file = server.bucket / "file"
    server.stop()
    try:
        with pytest.raises(StorageError, match="s3://test/file.*does not answer"):
            file.read_bytes()
    finally:
        server.start()


def test_what_a_server_says_is_not_repeated() -> None:
    said = (
        "Generic S3 error: status code: 403: <Error><Code>InvalidAccessKeyId</Code>"
        f"<AWSAccessKeyId>{KEY}</AWSAccessKeyId></Error>"
    )
    with pytest.raises(StorageError) as caught, storage_errors(Url("bucket", "map")):
        raise RuntimeError(said)
    assert (
        str(caught.value) == "s3://bucket/map cannot be used: the server answers InvalidAccessKeyId"
    )
    assert caught.value.__suppress_context__


def test_other_errors_are_left_alone(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="a bug"), storage_errors(Url("bucket", "map")):
        raise RuntimeError("a bug")
    with pytest.raises(RuntimeError, match="S3 error"), storage_errors(tmp_path):
        raise RuntimeError("Generic S3 error")
