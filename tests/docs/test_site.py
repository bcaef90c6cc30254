"""The documentation site builds without a warning, has no dead links, and needs no network."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import nearfar

pytest.importorskip("sphinx", reason="the extra docs is not installed")
pytest.importorskip("myst_nb", reason="the extra docs is not installed")

from bs4 import BeautifulSoup

REPOSITORY = Path(__file__).parents[2]
FRONT = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
RELATIVE_LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")
LOADING = {
    "img": "src",
    "script": "src",
    "link": "href",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "object": "data",
}
"""Elements that load what an attribute names."""
OF_CSS = re.compile(r"""(?:url\(|@import)\s*["']?([^"')\s]+)""")
SCRIPTED = re.compile(r"""(?:fetch|import|importScripts)\(\s*["'`]((?:https?:)?//[^"'`]+)""")


def built(out: Path) -> dict[Path, BeautifulSoup]:
    """The pages of a new build by their files."""
    command = [sys.executable, "-m", "sphinx", "-W", "-n", "--keep-going", "-q"]
    folders = ["-d", str(out / "doctrees"), str(REPOSITORY / "docs"), str(out / "html")]
    done = subprocess.run([*command, *folders], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {
        file: BeautifulSoup(file.read_text(encoding="utf-8"), "html.parser")
        for file in sorted((out / "html").rglob("*.html"))
    }


def is_remote(address: str) -> bool:
    return urlsplit(address).scheme in ("http", "https") or address.startswith("//")


def dead_links(pages: dict[Path, BeautifulSoup]) -> Iterator[str]:
    ids = {file: {element["id"] for element in page.select("[id]")} for file, page in pages.items()}
    for file, page in pages.items():
        for element in page.select("[href], [src]"):
            address = str(element.get("href") or element.get("src"))
            parts = urlsplit(address)
            if parts.scheme or address.startswith("//"):
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchor = unquote(parts.fragment)
            if not target.is_file() or (anchor and target in ids and anchor not in ids[target]):
                yield f"{file.name}: {address}"


def loaded_from_the_network(pages: dict[Path, BeautifulSoup], site: Path) -> Iterator[str]:
    for file, page in pages.items():
        for name, attribute in LOADING.items():
            for element in page.select(f"{name}[{attribute}]"):
                if is_remote(str(element[attribute])):
                    yield f"{file.name}: {element}"
        for script in page.select("script:not([src])"):
            yield from (f"{file.name}: {each}" for each in SCRIPTED.findall(script.text))
    for suffix, pattern in (("css", OF_CSS), ("js", SCRIPTED)):
        for file in sorted(site.rglob(f"*.{suffix}")):
            found = pattern.findall(file.read_text(encoding="utf-8"))
            yield from (f"{file.name}: {each}" for each in found if is_remote(each))


def test_site(tmp_path: Path) -> None:
    pages = built(tmp_path)
    site = tmp_path / "html"
    assert site / "index.html" in pages
    assert list(dead_links(pages)) == []
    assert list(loaded_from_the_network(pages, site)) == []
    described = {str(each["id"]) for page in pages.values() for each in page.select("dt[id]")}
    assert {f"nearfar.{name}" for name in nearfar.__all__} <= described


@pytest.mark.parametrize("page", FRONT)
def test_links_of_the_front_pages(page: str) -> None:
    links = RELATIVE_LINK.findall((REPOSITORY / page).read_text(encoding="utf-8"))
    assert [link for link in links if not (REPOSITORY / link).exists()] == []
