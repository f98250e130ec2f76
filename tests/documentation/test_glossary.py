"""Names in the glossary are names in scenario files and in the package."""

import importlib
import re

import pytest

from slidax.scenarios import schema
from tests.documentation.pages import ROOT

ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("## Symbols")[0].splitlines()
    if line.startswith("|") and not line.startswith(("| term", "|---"))
]
EVERY = pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])


@pytest.fixture(scope="module")
def keys():
    """Keys of the scenario schema by parent key; top-level keys have the empty parent."""
    whole = schema()
    return {"": set(whole["properties"]), **_below(whole["properties"], whole)}


def _below(properties, whole, visited=frozenset()):
    result = {}
    for key, value in properties.items():
        inner = set()
        for name in re.findall(r"#/\$defs/([^'\"]+)", str(value)):
            fields = whole["$defs"][name].get("properties", {})
            inner |= set(fields)
            if name not in visited:
                for below, names in _below(fields, whole, visited | {name}).items():
                    result.setdefault(below, set()).update(names)
        result.setdefault(key, set()).update(inner)
    return result


def test_each_glossary_term_occurs_once():
    assert len(ROWS) > 45 and len({row[0] for row in ROWS}) == len(ROWS)


@EVERY
def test_a_glossary_term_has_a_meaning_and_a_name_in_files_or_code(row):
    assert len(row) == 6 and len(row[1]) > 15 and (row[4] or row[5])


@EVERY
def test_a_path_in_the_glossary_exists_in_scenario_files(row, keys):
    for path in re.findall(r"`([^`]+)`", "" if "study file" in row[4] else row[4]):
        words = path.split(".")
        above = "" if words[0] != "…" else words[1]
        for word in words if words[0] != "…" else words[2:]:
            assert word in keys[above], path
            above = word


@EVERY
def test_a_code_name_in_the_glossary_exists_in_the_package(row):
    for path in re.findall(r"`([^`]+)`", row[5]):
        thing = importlib.import_module("slidax")
        for word in path.split("."):
            fields = getattr(thing, "__dataclass_fields__", {})
            if word in fields:
                thing = fields[word]
            elif hasattr(thing, word):
                thing = getattr(thing, word)
            else:
                thing = importlib.import_module(f"{thing.__name__}.{word}")
