import json
import re

import pytest

from .commands import in_process


def manifest_in(folder):
    text = (folder / "index.html").read_text(encoding="utf-8")
    result = re.search(r'<script type="application/json" id="playground">(.*?)</script>', text, re.DOTALL)
    assert result
    return json.loads(result[1])


@pytest.mark.full
def test_web_export_writes_one_page_and_prints_its_contents(tmp_path):
    done = in_process(
        *("export", "web", "example-4.1-1khz", "--with", "printed,slotine_li"),
        *("--set", "simulation.t1=1", "--set", "scheme.surface.k1=0.4", "--out", str(tmp_path / "site")),
        code=0,
    )
    assert [file.name for file in (tmp_path / "site").iterdir()] == ["index.html"]
    manifest = manifest_in(tmp_path / "site")
    schemes = [setting["scheme"] for setting in manifest["settings"]]
    assert schemes == ["cftsmppc", "cftsmppc-printed", "slotine_li"]
    tunables = sum(len(setting["tunables"]) for setting in manifest["settings"])
    assert f"3 laws, {len(manifest['programs'])} programs, {tunables} sliders" in done.stdout
    assert str(tmp_path / "site" / "index.html") in done.stdout
    own = manifest["settings"][0]
    assert next(tunable["default"] for tunable in own["tunables"] if tunable["path"] == "scheme.surface.k1") == 0.4
    assert [choice["path"] for choice in own["choices"]] == ["simulation.period", "sensor.delay"]
    assert [light["certificate"] for light in own["certificates"]][:3] == [
        *("admissibility", "inertia_ratio", "tracking_bound")
    ]


@pytest.mark.full
def test_web_page_of_a_seven_joint_arm_offers_periods_and_delays(tmp_path):
    site = str(tmp_path / "site")
    in_process("export", "web", "panda-payload", "--set", "simulation.t1=0.5", "--out", site, code=0)
    own = manifest_in(tmp_path / "site")["settings"][0]
    assert {choice["path"]: choice["values"] for choice in own["choices"]} == {
        "simulation.period": [0.0005, 0.001, 0.002],
        "sensor.delay": [0.0, 1.0],
    }
    assert len({variant["program"] for variant in own["variants"]}) == 2
