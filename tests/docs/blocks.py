"""Code blocks and commands of the documentation's pages."""

import itertools
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

REPOSITORY = Path(__file__).parents[2]


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        page: its path in the repository.
        line: number of its first line in the page.
        language: what stands behind the fence.
        text: what stands in it.
    """

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


@dataclass(frozen=True)
class Command:
    """A command of a block, or of a line of text.

    Attributes:
        page: its path in the repository.
        line: number of its first line in the page.
        words: of the command, without comments and redirections.
    """

    page: str
    line: int
    words: tuple[str, ...]

    @property
    def text(self) -> str:
        return " ".join(self.words)

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def pages() -> list[str]:
    """Paths in the repository of all pages that tell a reader what to type."""
    below = sorted(
        file.relative_to(REPOSITORY).as_posix() for file in REPOSITORY.glob("docs/**/*.md")
    )
    return ["README.md", "CONTRIBUTING.md", *(page for page in below if "/_build/" not in page)]


def blocks(page: str) -> Iterator[Block]:
    """The fenced blocks of a page."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    for token in MarkdownIt().parse(text):
        if token.type == "fence" and token.map:
            yield Block(page, token.map[0] + 2, token.info.partition(" ")[0], token.content)


def commands(block: Block) -> Iterator[Command]:
    """The commands of a block of the shell."""
    lines = iter(enumerate(block.text.splitlines(), block.line))
    for number, line in lines:
        whole = line
        while whole.endswith("\\"):
            whole = whole[:-1] + next(lines)[1]
        shell = shlex.shlex(whole, posix=True, punctuation_chars=True)
        shell.whitespace_split = True
        for between, words in itertools.groupby(shell, lambda word: word in ("&&", "|", ";")):
            if not between:
                kept = itertools.takewhile(lambda word: word != ">", words)
                yield Command(block.page, number, tuple(kept))


def commands_in_text(page: str) -> Iterator[Command]:
    """The commands of nearfar, of Python and of pip in the text of a page, outside its blocks."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    for token in MarkdownIt().parse(text):
        line = token.map[0] + 1 if token.map else 0
        for child in token.children or ():
            line += child.type in ("softbreak", "hardbreak")
            if child.type == "code_inline":
                yield from _said(Block(page, line, "console", child.content))


def _said(block: Block) -> Iterator[Command]:
    if block.text.startswith(("nearfar ", "python ", "pip ")):
        yield from commands(block)
