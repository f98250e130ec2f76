"""The flagship path on the two-link arm, with all of its real parts: requirements, design, certificates, exported C."""

import json
import sys

from slidax.design import candidates, search
from slidax.export import export_c
from slidax.scenarios import load
from tests.cli.commands import in_process
from tests.design.test_requirements import EXAMPLES
from tests.export.exported import COMPILERS, compiled, needs_a_compiler, run


@needs_a_compiler
def test_requirements_become_a_certified_law_whose_c_code_reproduces_the_golden_samples(tmp_path, monkeypatch):
    # A short search and short runs, which make the design less accurate only.
    monkeypatch.setattr(search, "GENERATIONS", 2)
    monkeypatch.setattr(sys.modules["slidax.design.design"], "DRIFTS", (1.0,))
    monkeypatch.setattr(candidates, "HORIZONS", (28.0,))
    monkeypatch.setattr(candidates, "LONG_HORIZONS", (40.0,))
    requirements = tmp_path / "requirements.yaml"
    text = (EXAMPLES / "two-link-along.yaml").read_text(encoding="utf-8")
    text = text.replace("t1: 3.0", "t1: 1.5").replace("accuracy: best", "accuracy: 5.0e-3")
    requirements.write_text(text, encoding="utf-8")
    done = in_process("design", str(requirements), "--out", str(tmp_path / "arm.yaml"), "--json", "--runs", "10")
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["designed"] is True and answer["proof"] == "bound"
    certificates = {each["name"]: each for each in answer["certificates"]}
    assert certificates["tracking_bound"]["holds"] is True
    assert not [name for name, each in certificates.items() if each["holds"] is False]
    export_c(load(tmp_path / "arm.yaml"), tmp_path / "c", name="law")
    compiled(
        COMPILERS[0], tmp_path / "c", "slidax_law.c", "slidax_law_scenario.c", "test_law.c", "-o", "test_law", "-lm"
    )
    assert run(tmp_path / "c", "./test_law").endswith("0 faults\n")
