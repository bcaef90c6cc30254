"""Sentences of the README and of the pages are short."""

import itertools
import re
import statistics
from collections.abc import Iterator

import pytest
from markdown_it import MarkdownIt

from tests.docs.blocks import REPOSITORY, pages

MEDIAN = 15
LONGEST_IN_README = 30
LONGEST_IN_PAGES = 30
END = re.compile(r"(?<!e\.g\.)(?<!i\.e\.)(?<=[.!?])[\")]*\s+")
"""Between two sentences; a full stop inside a word or a number is none."""


def texts(page: str) -> Iterator[str]:
    """The paragraphs and items of lists of a page, without code blocks, tables and headings."""
    content = (REPOSITORY / page).read_text(encoding="utf-8")
    tokens = MarkdownIt().enable("table").parse(content)
    for before, token in itertools.pairwise(tokens):
        if token.type == "inline" and before.type == "paragraph_open":
            words = [_word(child.type, child.content) for child in token.children or ()]
            yield "".join(words)


def _word(kind: str, content: str) -> str:
    """What a part of a text is read as; code is one word, a picture none."""
    if kind == "code_inline":
        return "code"
    if kind == "text":
        return content
    return " " if kind in ("softbreak", "hardbreak") else ""


def sentences(page: str) -> list[str]:
    """The sentences of a page; a line of links between dots is none."""
    prose = [text for text in texts(page) if text.count(" · ") < 3]
    return [each for text in prose for each in END.split(text.strip()) if each]


def length(sentence: str) -> int:
    return sum(any(letter.isalnum() for letter in word) for word in sentence.split())


def test_sentences_are_told_apart() -> None:
    text = "Version 0.1 is here, e.g. for us. nearfar has `a.b`. (Or not.) Is it? Yes"
    assert len(END.split(text)) == 5
    assert length("It takes 0.5 s - at 640x480.") == 6


def test_the_readme_is_easy_to_read() -> None:
    lengths = [length(each) for each in sentences("README.md")]
    assert len(lengths) > 50
    assert statistics.median(lengths) <= MEDIAN
    assert [each for each in sentences("README.md") if length(each) > LONGEST_IN_README] == []


@pytest.mark.parametrize("page", pages())
def test_no_sentence_is_too_long(page: str) -> None:
    assert [each for each in sentences(page) if length(each) > LONGEST_IN_PAGES] == []
