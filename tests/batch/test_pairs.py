"""Lists of pairs in all forms, and far images with several near ones."""

from pathlib import Path

import pytest

from nearfar import SettingsError
from nearfar.batch.pairs import Pair, distinct_names, pairs_with, read_pairs


@pytest.mark.parametrize(
    ("text", "near_first"),
    [
        ("far.jpg,a b.jpg\nfar.jpg,c.jpg\n", False),
        ("far.jpg\ta b.jpg\nfar.jpg\tc.jpg", False),
        ('"far.jpg";"a b.jpg"\r\nfar.jpg; c.jpg\r\n', False),
        ("# a comment\n\nfar.jpg,a b.jpg\n\nfar.jpg,c.jpg\nfar.jpg,c.jpg\n", False),
        ("\ufeffscore,Near,far\n1,a b.jpg,far.jpg\n2,c.jpg,far.jpg\n", False),
        ("a b.jpg,far.jpg\nc.jpg,far.jpg\n", True),
    ],
)
def test_a_list_in_any_form(text: str, near_first: bool, tmp_path: Path) -> None:
    file = tmp_path / "pairs.txt"
    file.write_bytes(text.encode())
    far = tmp_path / "far.jpg"
    expected = [Pair(far, tmp_path / "a b.jpg"), Pair(far, tmp_path / "c.jpg")]
    assert read_pairs(file, near_first=near_first) == expected


def test_a_list_of_hloc(tmp_path: Path) -> None:
    file = tmp_path / "pairs.txt"
    file.write_text("query/1.jpg db/7.jpg\nquery/1.jpg db/9.jpg\n")
    found = read_pairs(file, folder="images", near_first=True)
    query = Path("images/query/1.jpg")
    assert found == [Pair(Path("images/db/7.jpg"), query), Pair(Path("images/db/9.jpg"), query)]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "no pairs"),
        ("# nothing\n", "no pairs"),
        ("a.jpg b.jpg\na b.jpg c.jpg\n", "line 2: 2 columns are needed, not 3"),
        ("a.jpg,b.jpg\na.jpg,\n", "line 2"),
        ("a.jpg\n", "line 1"),
    ],
)
def test_a_line_without_two_paths_is_refused(text: str, word: str, tmp_path: Path) -> None:
    file = tmp_path / "pairs.txt"
    file.write_text(text)
    with pytest.raises(SettingsError, match=word):
        read_pairs(file)


def test_a_list_that_is_missing(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="No such file"):
        read_pairs(tmp_path / "no.csv")


def test_folders_without_hidden_files_and_the_far_image_itself(tmp_path: Path) -> None:
    for name in ("far.jpg", "b.jpg", "a.png", ".hidden.jpg", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "gone.jpg").symlink_to("nothing")
    far, missing = tmp_path / "far.jpg", tmp_path / "missing.jpg"
    found = pairs_with(far, [missing, tmp_path, missing])
    names = [pair.near.name for pair in found]
    assert names == ["missing.jpg", "a.png", "b.jpg", "gone.jpg"]


def test_names_do_not_depend_on_what_follows() -> None:
    files = [Path("a/x.jpg"), Path("b/x.png"), Path("x-2.jpg"), Path("c/x.jpg")]
    names = distinct_names(files)
    assert names == ["x", "x-2", "x-2-2", "x-3"]
    assert distinct_names(files[:2]) == names[:2]
