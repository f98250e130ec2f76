"""`slidax export web`."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from .commands import in_process


def manifest_in(folder: Path) -> dict:
    text = (folder / "index.html").read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="playground">(.*?)</script>', text, re.DOTALL)
    assert found
    return json.loads(found[1])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--with", "pid"), "name it"),
        (("--set", "disturbance.scale=0"), "name it"),
        (("no-such",), "unknown scenario `no-such`"),
        (("example-4.1-1khz", "--with", "computed_torqe"), "`computed_torque`"),
        (("example-4.1-1khz", "--set", "scheme.surface.k1=-1"), "must be > 0"),
    ],
)
def test_invalid_request_is_refused_in_one_line(arguments: tuple[str, ...], said: str, tmp_path: Path) -> None:
    done = in_process("export", "web", *arguments, "--out", str(tmp_path / "site"))
    assert done.exit_code == 2
    assert said in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "site").exists()


@pytest.mark.full
def test_a_scenario_becomes_one_file_that_says_what_is_in_it(tmp_path: Path) -> None:
    done = in_process(
        *("export", "web", "example-4.1-1khz", "--with", "printed,slotine_li"),
        *("--set", "simulation.t1=1", "--set", "scheme.surface.k1=0.4", "--out", str(tmp_path / "site")),
    )
    assert done.exit_code == 0, done.stderr
    assert [file.name for file in (tmp_path / "site").iterdir()] == ["index.html"]
    made = manifest_in(tmp_path / "site")
    schemes = [setting["scheme"] for setting in made["settings"]]
    assert schemes == ["cftsmppc", "cftsmppc-printed", "slotine_li"]
    tunables = sum(len(setting["tunables"]) for setting in made["settings"])
    assert f"3 laws, {len(made['programs'])} programs, {tunables} sliders" in done.stdout
    assert str(tmp_path / "site" / "index.html") in done.stdout
    own = made["settings"][0]
    assert next(tunable["default"] for tunable in own["tunables"] if tunable["path"] == "scheme.surface.k1") == 0.4
    assert [choice["path"] for choice in own["choices"]] == ["simulation.period", "sensor.delay"]
    assert [light["certificate"] for light in own["certificates"]][:3] == [
        *("admissibility", "inertia_ratio", "loop_rate"),
    ]


@pytest.mark.full
def test_the_page_of_seven_joints_has_choices_and_says_what_was_not_computed(tmp_path: Path) -> None:
    site = str(tmp_path / "site")
    done = in_process("export", "web", "panda-payload", "--set", "simulation.t1=0.5", "--out", site)
    assert done.exit_code == 0, done.stderr
    own = manifest_in(tmp_path / "site")["settings"][0]
    assert {choice["path"]: choice["values"] for choice in own["choices"]} == {
        "simulation.period": [0.0005, 0.001, 0.002],
        "sensor.delay": [0.0, 1.0],
    }
    assert len({variant["program"] for variant in own["variants"]}) == 2
    light = next(one for one in own["certificates"] if one["certificate"] == "loop_rate")
    assert light["holds"] is None and "not computed" in light["statement"]
