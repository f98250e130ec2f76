"""Code and commands that examples, README and documentation show run."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from typer.main import get_command

from scripts.documentation.pages import START, modules_of_other_extras
from slidax.cli import app
from tests.cli.commands import in_process

SCRIPTS = sorted((Path(__file__).parents[2] / "examples").glob("[0-9]*.py"))
EVERY = pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)


def output(folder: Path, *arguments: str) -> str:
    """Output of Python, with warnings as errors."""
    result = subprocess.run(
        [sys.executable, "-W", "error", *arguments],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    mpl.use("agg")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def assert_says_something(printed: str) -> None:
    assert printed.strip() and "nan" not in printed


@EVERY
def test_an_example_runs_and_prints_something(script, empty_folder, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(script)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runpy.run_path(str(script), run_name="__main__")
    assert_says_something(capsys.readouterr().out)


@pytest.mark.full
@EVERY
def test_an_example_runs_in_its_own_process_without_warnings(script, tmp_path):
    assert_says_something(output(tmp_path, str(script)))


@EVERY
def test_an_example_is_under_60_lines(script):
    assert len(script.read_text(encoding="utf-8").splitlines()) < 60


ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "your-own-law.md").read_text(encoding="utf-8").partition("\n## A law with a state\n")[2]
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@cache
def names() -> dict[str, Any]:
    """Names that the later blocks of docs/your-own-law.md define, run in their order."""
    namespace: dict[str, Any] = {}
    for code in BLOCKS:
        exec(compile(code, "your-own-law.md", "exec"), namespace)
    return namespace


def test_the_documented_law_with_a_state_has_at_most_30_lines_and_tracks():
    (block,) = (block for block in BLOCKS if "class ComputedTorquePID" in block)
    scheme = block.split("class ")[1].split("\n\n\n")[0]
    assert len([line for line in scheme.splitlines() if line.strip()]) <= 30
    run = names()["run"]
    assert run.outcome.ok and np.max(run.tally.steady_error) < 2e-3


def test_the_documented_biased_sensor_causes_a_steady_error_equal_to_its_bias():
    biased = names()["biased"]
    assert biased.outcome.ok
    # The law brings the biased measurement to the reference.
    np.testing.assert_allclose(biased.tally.steady_error, [1e-4, 0.0], atol=1e-6)


def test_the_documented_surface_has_a_generated_docstring_and_stays_in_its_envelope():
    surface = names()["Flattening"]
    assert "- `slope`: k, slope at zero, one number or [n], 1/s, > 0." in surface.__doc__
    assert names()["flattened"].outcome.ok


def test_modules_of_extras_that_a_page_does_not_install_are_hidden():
    hidden = modules_of_other_extras(START.read_text(encoding="utf-8"))
    assert {"mujoco", "foxglove", "SALib"} <= hidden and not {"pyarrow", "pandas", "viser", "llvmlite"} & hidden
    assert not modules_of_other_extras("pip install 'slidax[all]'")


def test_commands_and_code_of_the_getting_started_page_run_in_order(empty_folder, capsys, monkeypatch):
    namespace: dict[str, Any] = {}
    for module in modules_of_other_extras(START.read_text(encoding="utf-8")):
        monkeypatch.setitem(sys.modules, module, None)
    for language, text in re.findall(r"```(\w+)\n(.*?)```", START.read_text(encoding="utf-8"), re.DOTALL):
        if language == "yaml":
            name = re.match(r"# (\S+\.yaml)\n", text)
            assert name, "the first line of a file on that page is its name"
            (empty_folder / name[1]).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, START.name, "exec"), namespace)
        elif language == "console":
            for line in text.strip().splitlines():
                command = shlex.split(line.removeprefix("$ slidax "), comments=True)
                result = in_process(*command)
                assert result.exit_code == 0, f"{line}: {result.output}"
        else:
            assert language == "sh"
    assert namespace["run"].outcome.ok and namespace["later"].simulate().outcome.ok and namespace["printed"].outcome.ok
    assert len(namespace["runs"]) == 3
    assert {path.name for path in empty_folder.iterdir()} >= {"my-arm.yaml", "report", "error.svg", "torque.svg"}
    assert "ok" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "extra"), [("--out report", "parquet"), ("run.frame()", "frame"), ("--view", "view")]
)
def test_the_getting_started_page_installs_the_extras_that_it_uses(words, extra):
    page = START.read_text(encoding="utf-8")
    (line,) = re.findall(r"pip install '\.\[(.*)\]'", page)
    assert words in page and extra in line.split(",")


def test_pages_state_the_default_number_of_runs_of_slidax_design():
    (runs,) = (parameter for parameter in get_command(app).commands["design"].params if parameter.name == "runs")
    pages = {"explain.md": "its default, `--runs {}`", "design.md": "{} random cases by default"}
    for page, words in pages.items():
        assert words.format(runs.default) in (ROOT / "docs" / page).read_text(encoding="utf-8")


README = (ROOT / "README.md").read_text(encoding="utf-8")


def table_rows(text, name):
    """First cell to further cells of the table with this mark."""
    lines = text.split(f"<!-- table {name} -->")[1].split("<!-- end -->")[0].strip().splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]
    return {first: others for first, *others in cells}


def test_readme_table_of_controllers_has_the_numbers_of_the_comparison_page():
    page = (ROOT / "docs" / "benchmark-of-schemes.md").read_text(encoding="utf-8")
    fronts, worst = table_rows(page, "rival-fronts"), table_rows(page, "rival-worst")
    rows = table_rows(README, "fronts")
    assert len(rows) >= 6 and "`cftsmppc`" in rows
    for law, (*errors, inside) in rows.items():
        assert [*errors, inside] == [*fronts[law][: len(errors)], worst[law][1]]


def test_readme_table_of_controllers_names_the_law_with_the_least_error_at_each_noise():
    fronts = table_rows((ROOT / "docs" / "benchmark-of-schemes.md").read_text(encoding="utf-8"), "rival-fronts")
    rows = table_rows(README, "fronts")
    for column in range(3):
        errors = {law: float(cells[column]) for law, cells in fronts.items() if cells[column] != "-"}
        assert min(errors.values()) in {float(cells[column]) for cells in rows.values() if cells[column] != "-"}


def test_the_panda_animation_is_small_and_self_contained():
    text = (ROOT / "docs" / "figures" / "panda-moving.svg").read_text(encoding="utf-8")
    assert len(text) < 2_000_000
    assert "<animate" in text and "prefers-color-scheme: dark" in text and "<title" in text
    assert not re.findall(r"<script|https?://(?!www\.w3\.org/2000/svg)", text)


def test_readme_has_at_most_120_lines_and_the_commands_make_demo_and_make_test():
    assert len(README.splitlines()) <= 120
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert {"demo", "test"} <= set(re.findall(r"^make (\w+)", README, re.MULTILINE)) <= set(targets)


def test_readme_pictures_are_small_and_its_table_has_error_below_bound_below_envelope():
    pictures = re.findall(r'(?:src|srcset)="(docs/figures/hero[\w-]*\.svg)"', README)
    assert len(pictures) == 2
    for name in pictures:
        text = (ROOT / name).read_text(encoding="utf-8")
        assert len(text) < 60_000 and "prefers-color-scheme: dark" in text and "<title" in text
    rows = re.findall(r"^\| [^|]+ \| ([\d.]+) \|$", README.split("<!-- table hero -->")[1], re.MULTILINE)
    envelope, bound, largest, textbook = map(float, rows)
    assert largest < bound < envelope < textbook
