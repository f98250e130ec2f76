import inspect
import re

import pytest

from scripts.documentation.site import GROUPS, api_pages, check_links, parameters_page
from scripts.documentation.stage import Stage
from tests.architecture.test_architecture import ROOMS, public
from tests.documentation.pages import PAGES, ROOT
from tests.documentation.pages import name as path_of


@pytest.fixture(scope="module")
def reference():
    return api_pages()


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_the_api_page_of_a_subpackage_lists_all_its_exports(reference, room):
    pages, _ = reference
    text = pages[f"api/{room}.md"]
    assert f"]({room}.md)" in pages["api/index.md"]
    for name, thing in public(room):
        assert len(re.findall(rf"^::: [\w.]+\.{name}$", text, re.MULTILINE)) == 1, name
        assert f"[`{name}`](#" in text
        first = (inspect.getdoc(thing) or "").partition("\n")[0].replace("|", "\\|")
        assert first in text


def test_every_subpackage_is_in_one_group_of_the_api():
    assert sorted(room for group in GROUPS.values() for room in group) == sorted(set(ROOMS) - {"cli"})


def test_a_function_named_like_its_module_is_documented_as_a_function(reference):
    assert "\n::: slidax.analysis.explain.explain\n" in reference[0]["api/analysis.md"]
    assert "\n::: slidax.law.SlidingMode\n" in reference[0]["api/law.md"]


def test_api_pages_state_units_ranges_and_sources_of_the_declared_parameters(reference):
    _, facts = reference
    linear = facts["slidax.law.surfaces.Linear"]
    assert (
        "| `rate` | diagonal of Λ, how fast the error decays on the surface (one number or [n]) | 1/s | > 0, so "
        in linear
    )
    assert "Numbers: Table 1." in facts["slidax.law.presets.cftsmppc"]
    assert "SmoothFixedTime(k1=0.2" in facts["slidax.law.presets.cftsmppc"]
    assert "Unit: rad or m" in facts["slidax.analysis.metrics.steady_error"]
    assert not [text for text in facts.values() if " at 0x" in text]


def test_the_page_of_parameters_has_every_part_of_scenario_files():
    from slidax.scenarios import catalogue

    text = parameters_page()
    for kind, members in catalogue().items():
        for name in members if kind != "scenarios" else ():
            assert f"\n\n### `{name}` {{ #{kind}.{name} }}\n\n" in text
    assert (
        "| `surface.k1` | Diagonal of K1 | rad/s or m/s | > 0, so that K1 is diagonal positive definite (eq. 40) |"
        in text
    )


def test_every_page_of_the_navigation_exists_and_every_link_has_a_target():
    stage = Stage(ROOT / "nowhere")
    stage.lay_out()
    from ruamel.yaml import YAML

    from scripts.documentation.site import named

    contents = named(YAML().load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])
    assert len(contents) == len(set(contents))
    assert set(contents) - {"reference/parameters.md"} <= set(stage.pages)
    assert not [source for source in stage.files if not (ROOT / source).exists()]


def test_links_are_rewritten_for_the_site_and_code_is_unchanged():
    stage = Stage(ROOT / "nowhere")
    text = "[a](../examples/design) [b](../benchmarks/PERFORMANCE.md#x) `[c](../d)` [glossary.md](glossary.md)"
    result = stage.linked(f"{text}\n\n    [e](../f)\n", "docs/tutorials/../design.md", "design.md")
    assert result == (
        "[a](files/examples/design/index.md) [b](benchmarks.md#x) `[c](../d)` [Glossary and symbols](glossary.md)"
        "\n\n    [e](../f)\n"
    )
    assert stage.files == {"examples/design"}


def test_a_number_with_an_exponent_in_a_table_has_the_class_of_numbers_on_the_site():
    text = "| 1.2e-04 to 3e-5 | `1e-6` | abc1e-7 |\n"
    number = '<span class="number">{}</span>'.format
    assert Stage(ROOT).linked(text, "docs/x.md", "x.md") == (
        f"| {number('1.2e-04')} to {number('3e-5')} | `1e-6` | abc1e-7 |\n"
    )


def test_an_escaped_bar_in_table_code_has_no_backslash_on_the_site():
    text = "| `--arm own\\|auto` | a\\|b |\n\n```\na\\|b\n```\n"
    assert Stage(ROOT).linked(text, "docs/x.md", "x.md") == "| `--arm own|auto` | a\\|b |\n\n```\na\\|b\n```\n"


def prose(page):
    text = page.read_text(encoding="utf-8")
    return re.sub(r"^ *```.*?^ *```", lambda block: "\n" * block[0].count("\n"), text, flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=path_of)
def test_prose_has_no_accidental_quotation_list_or_broken_formula(page):
    text = prose(page)
    assert re.findall(r"^ *>=? *[\d.].*$", text, re.MULTILINE) == [], "a quotation"
    assert re.findall(r"\$`[^`\n]*$", text, re.MULTILINE) == [], "a formula over two lines is not set"
    item = r" *(?:[-*+]|[1-9]\d*\.) "
    for paragraph in re.split(r"\n\s*\n", text):
        first, *others = paragraph.strip("\n").split("\n")
        inside = [line for line in others if re.match(item.removeprefix(" *"), line)]
        assert not inside or re.match(item, first), f"a list within a paragraph is none: {inside}"


@pytest.mark.parametrize("page", PAGES, ids=path_of)
def test_every_column_of_a_table_has_a_title(page):
    heads = re.findall(r"^(\|.*\|)\n\|[ :|-]*-[ :|-]*\|$", prose(page), re.MULTILINE)
    assert not [head for head in heads if re.search(r"\|\s*(?=\|)", head)]


def site(folder, **pages):
    for name, text in pages.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return check_links(folder)


def test_broken_links_are_detected(tmp_path):
    result = site(
        tmp_path,
        index='<a href="other.html#here"><a href="other.html#gone"><a href="lost.html"><img src="a.svg">',
        other='<h1 id="here"></h1><a href="#here"><a href="https://example.org/"><a href="../out.html">',
    )
    assert [item.split(" (")[0] for item in result.broken] == [
        "index.html: other.html#gone",
        "index.html: lost.html",
        "index.html: a.svg",
        "other.html: ../out.html",
    ]
    assert list(result.outward) == ["https://example.org/"] and not result.foreign


def test_resources_from_another_host_are_detected(tmp_path):
    (tmp_path / "style.css").write_text("@import url(//fonts.example.org/a.css);", encoding="utf-8")
    result = site(tmp_path, index='<script src="https://cdn.example.org/x.js"></script><link href="style.css">')
    assert result.foreign == [
        "index.html: https://cdn.example.org/x.js",
        "style.css: a font or a style of another host",
    ]


@pytest.mark.full
@pytest.mark.skipif(not (ROOT / "site" / "index.html").exists(), reason="`make docs` has not been run")
def test_the_built_site_has_no_broken_link():
    result = check_links(ROOT / "site")
    assert result.pages > 80 and not result.broken and not result.foreign
