"""Prose of README and docs: short sentences, plain clauses, titles that name a task or a thing."""

import re

import pytest

from tests.documentation.pages import PAGES, name

LONGEST = 35
LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)]*\)")
SENTENCE_END = re.compile(r"(?<=[.!?:])\**\s+(?=[A-Z*\[`(‖\"0-9])")
LIST_ITEM = re.compile(r"^\s*([-*]|\d+\.) ", re.MULTILINE)


def lines_of(page):
    """Lines outside of code blocks and comments."""
    text = re.sub(r"^ *(`{3,}).*?^ *\1", "\n", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    return re.sub(r"`[^`\n]*`", "CODE", LINK.sub(r"\1", text)).splitlines()


def sentences(lines):
    kept = [line for line in lines if not line.startswith(("|", "#", "    "))]
    paragraphs = re.split(r"\n\s*\n", LIST_ITEM.sub("\n\n", "\n".join(kept)))
    return [part for text in paragraphs for part in SENTENCE_END.split(" ".join(text.split())) if part]


def too_long(sentence):
    return len(re.findall(r"[\w'-]+", sentence)) > LONGEST


def test_at_most_two_percent_of_the_sentences_have_more_than_35_words():
    parts = [sentence for page in PAGES for sentence in sentences(lines_of(page))]
    long = [sentence for sentence in parts if too_long(sentence)]
    assert len(parts) > 2000
    assert len(long) <= 0.02 * len(parts), "\n".join(long)


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "commands.md"], ids=name)
def test_a_page_does_not_contain_the_word_what_outside_of_questions(page):
    quoted = re.compile(r"^\| .* \| .*…")  # messages of other programs, cut to fit a table
    lines = [line for line in lines_of(page) if "?" not in line and not quoted.match(line)]
    assert not [line for line in lines if re.search(r"\bwhat\b", line, re.IGNORECASE)]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_the_title_of_a_page_is_no_question(page):
    title = page.read_text(encoding="utf-8").partition("\n")[0]
    assert title.startswith("# ") and not re.match(r"# (What|How|Why|Whether|B[e]side)\b|.*\?$", title)


def test_a_long_sentence_is_counted_across_lines_and_links():
    text = "Short one. Then " + "word " * 20 + "\n" + "[more words](page.md) " * 8 + "end.\n\n- An item.\n"
    assert [too_long(sentence) for sentence in sentences(LINK.sub(r"\1", text).splitlines())] == [False, True, False]
