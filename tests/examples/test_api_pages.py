"""The API pages that `make api` writes have every public name, with what its docstring says."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest

import slidax
from tests.architecture.test_architecture import ROOMS, public

ROOT = Path(slidax.__file__).parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("api")
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    subprocess.run([sys.executable, ROOT / "scripts" / "write-api", out], env=environment, check=True)
    return out


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_the_page_of_a_room_has_all_that_it_exports(folder: Path, room: str) -> None:
    text = (folder / f"{room}.md").read_text(encoding="utf-8")
    assert f"]({room}.md)" in (folder / "index.md").read_text(encoding="utf-8")
    assert " at 0x" not in text
    for name, thing in public(room):
        section = text.split(f"\n## `{name}`\n")
        assert len(section) == 2, name
        assert (inspect.getdoc(thing) or "").partition("\n")[0] in section[1].partition("\n## `")[0]


def test_a_part_shows_its_types_its_methods_and_what_is_declared(folder: Path) -> None:
    text = (folder / "surfaces.md").read_text(encoding="utf-8")
    assert "\nLinear(rate: PerJoint)\n" in text
    assert "### `Linear.pull_and_slope`" in text
    assert "- `rate`: diagonal of Λ, how fast the error decays on the surface, one number or [n], 1/s, > 0." in text
    scheme = (folder / "controllers.md").read_text(encoding="utf-8").split("## `cftsmppc`")[1].partition("\n## ")[0]
    assert "surface" in scheme and "Table 1" in scheme
