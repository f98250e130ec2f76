"""The page of guarantees states figures of other pages, and commands that exist."""

import re
from pathlib import Path

import pytest

from scripts.documentation.commands import check
from slidax.cli import app
from tests.documentation.pages import ROOT

PAGE = ROOT / "docs" / "guarantees.md"
STATUSES = ("proved", "tested", "measured", "never run")
FIGURE = re.compile(r"\d[\d ,.e-]*\d|\d")


def claims():
    """The rows of all tables whose first column is `claim`, by column."""
    text = PAGE.read_text(encoding="utf-8").partition("\n## Status of each claim\n")[2]
    for part in re.split(r"^### .*$", text, flags=re.MULTILINE)[1:]:
        rows = [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in cells(part)]
        yield from (dict(zip(rows[0], row, strict=True)) for row in rows[2:])


def cells(part):
    return [re.sub(r"\|(?= *\|)", "| ", line) for line in part.splitlines() if line.startswith("|")]


CLAIMS = list(claims())
EVERY = pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim["claim"][:40])


def test_the_guarantees_page_has_over_25_claims_and_uses_every_status():
    assert len(CLAIMS) > 25
    assert {re.match(r"\*\*([a-z ]+)\*\*", claim["status"])[1] for claim in CLAIMS} == set(STATUSES)


@EVERY
def test_a_figure_of_a_claim_occurs_on_the_page_that_the_claim_names(claim):
    pages = [(PAGE.parent / target).resolve() for target in re.findall(r"\]\(([^)#]+)", claim["page"])]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    for figure in FIGURE.findall(claim.get("figure", "")):
        assert re.search(rf"(?<![\d.]){re.escape(figure.strip())}(?![\d.])", text), (figure, pages)


@EVERY
def test_a_claim_names_its_command_or_is_marked_as_never_run(claim):
    assert claim["command"] or claim["status"].startswith("**never run**")


def test_a_measured_claim_names_its_machine():
    measured = [claim["status"] for claim in CLAIMS if claim["status"].startswith("**measured**")]
    assert measured
    for status in measured:
        assert re.match(r"\*\*measured\*\*: [^.]*\b2 (cores|processors)\b", status), status


@pytest.mark.parametrize("claim", [each for each in CLAIMS if each["command"]], ids=lambda claim: claim["claim"][:40])
def test_the_command_of_a_claim_exists(claim):
    words = claim["command"].strip("`").split()
    if words[0] == "slidax":
        check(words[1:], app)
    elif words[0] == "make":
        assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    elif words[0] == "scripts/measure":
        assert re.search(
            rf'^    "{words[1]}":', (ROOT / "scripts" / "measure").read_text(encoding="utf-8"), re.MULTILINE
        )
    elif words[0] == "pytest":
        assert (ROOT / words[-1]).exists()
    else:
        assert (ROOT / Path(*words[2].split("."))).exists()
