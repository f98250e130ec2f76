"""The code that the documentation shows runs."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from typer.main import get_command

from slidax.cli import app
from slidax.scenarios import parse
from slidax.scenarios.yaml_text import read_yaml
from tests.cli.commands import in_process

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
START = ROOT / "docs" / "getting-started.md"


@cache
def names() -> dict[str, Any]:
    """What the blocks of the page about extending define, run one after the other as a reader would."""
    found: dict[str, Any] = {}
    for code in BLOCKS:
        exec(compile(code, "extending.md", "exec"), found)
    return found


def test_the_scheme_on_the_page_about_extending_is_short_and_tracks() -> None:
    (block,) = (block for block in BLOCKS if "class ComputedTorquePID" in block)
    scheme = block.split("class ")[1].split("\n\n\n")[0]
    assert len([line for line in scheme.splitlines() if line.strip()]) <= 30
    run = names()["run"]
    assert run.outcome.ok
    assert np.max(run.tally.steady_error) < 2e-3


def test_the_sensor_and_the_estimator_there_are_used_and_the_error_is_the_sensors() -> None:
    biased = names()["biased"]
    assert biased.outcome.ok
    # The arm is brought to where the sensor says that it should be.
    np.testing.assert_allclose(biased.tally.steady_error, [1e-4, 0.0], atol=1e-6)


def test_the_surface_there_is_explained_by_its_declarations_and_holds_the_envelope() -> None:
    surface = names()["Flattening"]
    assert "- `slope`: k, slope at zero, one number or [n], 1/s, > 0." in surface.__doc__
    assert names()["flattened"].outcome.ok


@pytest.fixture
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    mpl.use("agg")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def modules_of_other_extras(page: str) -> set[str]:
    """Modules of the extras that the install command of a page does not name."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (line,) = re.findall(r"pip install '\.\[(.*)\]'", page)
    named = {_package(need) for extra in line.split(",") for need in extras[extra]}
    others = {_package(need) for extra, needs in extras.items() if extra != "all" for need in needs} - named
    found = {module for module, packages in packages_distributions().items() if {*map(_package, packages)} & others}
    assert {"mujoco", "foxglove", "SALib"} <= found and "pyarrow" not in found
    return found


def _package(requirement: str) -> str:
    return re.split(r"[>=<\[; ]", requirement)[0].lower().replace("_", "-")


def test_the_commands_and_the_code_for_beginners_run_in_their_order(
    empty_folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: dict[str, Any] = {}
    for module in modules_of_other_extras(START.read_text(encoding="utf-8")):
        monkeypatch.setitem(sys.modules, module, None)
    for language, text in re.findall(r"```(\w+)\n(.*?)```", START.read_text(encoding="utf-8"), re.DOTALL):
        if language == "yaml":
            name = re.match(r"# (\S+\.yaml)\n", text)
            assert name, "the first line of a file on that page is its name"
            (empty_folder / name[1]).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, START.name, "exec"), found)
        elif language == "console":
            for line in text.strip().splitlines():
                command = shlex.split(line.removeprefix("$ slidax "), comments=True)
                result = in_process(*command)
                assert result.exit_code == 0, f"{line}: {result.output}"
        else:
            assert language == "sh"
    assert found["run"].outcome.ok and found["later"].simulate().outcome.ok and found["printed"].outcome.ok
    assert len(found["runs"]) == 3
    assert {path.name for path in empty_folder.iterdir()} >= {"my-arm.yaml", "report", "error.svg", "torque.svg"}
    assert "ok" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "extra"), [("--out report", "parquet"), ("run.frame()", "frame"), ("--view", "view")]
)
def test_the_page_for_beginners_installs_what_it_uses(words: str, extra: str) -> None:
    page = START.read_text(encoding="utf-8")
    (line,) = re.findall(r"pip install '\.\[(.*)\]'", page)
    assert words in page and extra in line.split(",")


def test_the_pages_name_the_default_of_design() -> None:
    (runs,) = (one for one in get_command(app).commands["design"].params if one.name == "runs")
    for page, words in (("newcomer.md", "`--runs {}`, its"), ("tutorials/design-and-certify.md", "{} cases are tried")):
        assert words.format(runs.default) in (ROOT / "docs" / page).read_text(encoding="utf-8")


def test_every_scenario_on_the_page_about_files_is_valid() -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8"), re.DOTALL)
    first = read_yaml(blocks[0])
    parse(blocks[0])
    added = [read_yaml(block) for block in blocks[1:]]
    for block in [block for block in added if isinstance(block, dict)]:
        scheme = first["scheme"] if "name" not in block.get("scheme", {}) else {}
        changes = {**block, "scheme": {**scheme, **block.get("scheme", {})}}
        parse(blocks[0], changes)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_that_a_page_links_to_is_there(page: Path) -> None:
    for link in re.findall(r"\]\((?!http)([^)#]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / link).exists(), link
