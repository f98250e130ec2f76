import ast
import re

import pytest

from scripts.documentation.commands import Files, PageError, check, commands
from scripts.documentation.pages import MARKS, PageRun, blocks, check_yaml, dotted
from slidax import DefinitionError
from slidax.cli import app
from tests.documentation.pages import CODE, DOCS, PAGES, ROOT, TERMINAL, name, of

EVERY = pytest.mark.parametrize("page", PAGES, ids=name)
EVERY_OF_DOCS = pytest.mark.parametrize("page", DOCS, ids=name)
SYNOPSIS = re.compile(r"^    slidax (.*)$", re.MULTILINE)


@EVERY
def test_every_command_of_a_page_is_accepted_by_slidax(page):
    for block in of(page):
        if block.language in TERMINAL:
            for command in commands(block.language, block.text):
                if command.line.startswith("slidax "):
                    check(command.arguments if command.is_ours else [], app)


@EVERY
def test_a_command_synopsis_names_existing_options(page):
    for form in SYNOPSIS.findall(page.read_text(encoding="utf-8")):
        words = re.findall(r"--[a-z-]+|[a-z0-9]+", form.partition(" --")[0])
        known = " ".join(sorted(_options(words)))
        for option in re.findall(r"--[a-z-]+", form):
            assert option in known.split(), (form, option)


def _options(words):
    from typer.main import get_command

    command = get_command(app)
    for word in words:
        if word in getattr(command, "commands", {}):
            command = command.commands[word]
    return {option for item in command.params for option in [*item.opts, *item.secondary_opts]}


@EVERY_OF_DOCS
def test_files_that_commands_read_exist_or_are_written_earlier_on_the_page(page):
    files = Files(ROOT)
    for block in of(page):
        files.written |= {line.partition("=")[0].strip() for line in block.marks.get("file", "").splitlines()}
        if named := re.match(r"# (\S+\.ya?ml)\n", block.text):
            files.written.add(named[1])
        if block.language in ("python", "before"):
            files.written |= set(re.findall(r"[\"']([\w.-]+\.(?:csv|yaml|json|html))[\"']", block.text))
        if block.language in TERMINAL and "not run" not in block.marks:
            for command in commands(block.language, block.text):
                if command.is_ours:
                    files.follow(command.arguments)


@EVERY_OF_DOCS
def test_skipped_blocks_have_a_reason_and_python_blocks_have_valid_syntax(page):
    for block in of(page):
        where = f"{name(page)}, line {block.first + 1}"
        assert set(block.marks) <= {*MARKS, "file"}, where
        if "not run" in block.marks:
            assert len(block.marks["not run"]) > 10, f"{where}: a reason is a sentence"
        elif block.language in TERMINAL and "shell" not in block.marks:
            assert all(item.is_ours for item in commands(block.language, block.text)), f"{where}: `shell` or `not run`"
        if block.language in ("python", "py"):
            ast.parse(block.text)


@EVERY_OF_DOCS
def test_the_yaml_of_a_page_is_valid(page, tmp_path):
    for block in of(page):
        if block.language == "yaml":
            check_yaml(block.text, block.marks.get("part of", ""), tmp_path)


@pytest.mark.parametrize("page", [page for page in DOCS if "<!-- small:" in page.read_text(encoding="utf-8")], ids=name)
def test_code_blocks_marked_small_run_without_error(page, tmp_path):
    outcomes = PageRun(page, tmp_path, tmp_path / "made", small=True).run()
    marked = [block for block in of(page) if "small" in block.marks]
    assert len([item for item in outcomes if item.texts]) == len(marked)


def test_the_readme_shows_the_output_of_its_commands(tmp_path):
    outcomes = PageRun(ROOT / "README.md", tmp_path, tmp_path / "made").run()
    shown = [item for item in outcomes if item.texts]
    assert len(shown) == 3 and "✓ Inside the envelope." in shown[0].texts[1]
    assert (tmp_path / "error.svg").exists()


@pytest.mark.full
def test_the_code_of_all_pages_runs():
    from scripts.documentation.pages import run_all

    result, failed = run_all(jobs=2, only=None)
    assert not failed, "\n\n".join(failed)
    assert len(result) >= len([page for page in DOCS if any(block.language in CODE for block in of(page))])


# --- detection of errors on pages ---


@pytest.mark.parametrize(
    "line", ["run example-4.1 --outt x", "rum example-4.1", "export d example-4.1 --out x", "list --json=maybe", "run"]
)
def test_an_invalid_command_on_a_page_is_detected(line):
    with pytest.raises(PageError):
        check(line.split(), app)


@pytest.mark.parametrize(
    "line", ["run example-4.1 --set a.b=1 --set c=2 --out x", "list", "--help", "export c x --out y"]
)
def test_a_valid_command_on_a_page_passes(line):
    check(line.split(), app)


def test_a_missing_file_on_a_page_is_detected():
    files = Files(ROOT)
    with pytest.raises(PageError, match=r"mine\.yaml"):
        files.follow(["run", "mine.yaml"])
    with pytest.raises(PageError, match=r"arm\.yaml"):
        files.follow(["run", "example-4.1", "--set", "robot.file=arm.yaml"])
    files.follow(["new", "--robot", "examples/robots/scara.urdf", "--out", "mine.yaml"])
    files.follow(["run", "mine.yaml", "--out", "report"])
    files.follow(["run", "report/worst.yaml"])


def test_invalid_yaml_on_a_page_is_detected(tmp_path):
    with pytest.raises(DefinitionError, match="horizn"):
        check_yaml("scheme:\n  sampled_data: {horizn: 0.01}\n", "example-4.1-1khz", tmp_path)
    with pytest.raises(PageError, match="part of"):
        check_yaml("sensor: {delay: 1}\n", "", tmp_path)
    assert dotted({"a": {"b": 1, "c": {"kind": "x", "d": 2}}}) == {"a.b": 1, "a.c": {"kind": "x", "d": 2}}


def test_marks_belong_to_the_next_block_and_a_mark_without_block_is_refused():
    text = "<!-- exit: 3 -->\n<!-- with: --runs 2 -->\n\n```console\n$ slidax list\n```\n\n<!-- a remark -->\nText\n"
    (block,) = blocks(text)
    assert (block.language, block.first, block.last) == ("console", 0, 5)
    assert block.marks == {"exit": "3", "with": "--runs 2"}
    (inner,) = blocks("1. In a list:\n\n    <!-- exit: 3 -->\n    ```sh\n    slidax list\n    ```\n")
    assert (inner.marks, inner.text) == ({"exit": "3"}, "slidax list\n")
    with pytest.raises(PageError, match="no block after it"):
        blocks("<!-- exit: 3 -->\n\nText\n\n```sh\nls\n```\n")
    with pytest.raises(PageError, match="no end"):
        blocks("```sh\nls\n")


def test_commands_are_read_after_the_prompt_of_a_terminal_block():
    result = commands("console", "$ slidax run x \\\n    --out y   # why\nsaid\n$ ls\n")
    assert [item.arguments for item in result] == [["run", "x", "--out", "y"], ["ls"]]
    assert result[0].shown == ["said"]
    assert [item.is_ours for item in commands("sh", "slidax list && ls\nslidax list\n# no\n")] == [False, True]


PATH_OF_MODULE = re.compile(r"`((?:[\w-]+/)+\w+\.py)(?:::\w+)?`")


@EVERY
def test_module_paths_in_the_text_of_a_page_exist(page):
    for path in PATH_OF_MODULE.findall(page.read_text(encoding="utf-8")):
        assert any((ROOT / top / path).is_file() for top in ("", "src", "src/slidax")), path
