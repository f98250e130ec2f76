import io
import json
from dataclasses import replace

import pytest

from slidax import scenarios
from slidax.report import Rival
from slidax.scenarios.yaml_text import as_yaml

from .commands import answer_of, in_process

SHORT = ("--set", "simulation.t1=0.5")

HASTY = ("--set", "scheme.performance.deadline=0.05")


def test_compare_json_lists_each_scheme_and_the_best_per_metric():
    answer = answer_of("compare", "example-4.1", "--schemes", "cftsmppc, ftsmc", *SHORT)
    assert (answer["scenario"], answer["robot"], answer["t1"]) == ("example-4.1", "two_link", 0.5)
    assert list(answer["schemes"]) == ["cftsmppc", "ftsmc"]
    assert [each["outcome"] for each in answer["schemes"].values()] == ["ok", "ok"]
    assert answer["best"]["peak_torque"] == [["ftsmc"], ["ftsmc"]]
    alone = json.loads(in_process("run", "example-4.1", *SHORT, "--json").stdout)
    assert answer["schemes"]["cftsmppc"]["metrics"] == alone["metrics"]


def test_compare_table_has_a_column_per_scheme_and_a_row_per_metric_and_joint():
    result = in_process("compare", "example-4.1", "--schemes", "cftsmppc,ftsmc", code=0)
    assert result.stdout.splitlines()[1] == "✓ Both schemes stay inside the envelope."
    lines = [line.strip() for line in result.stdout.splitlines()]
    assert lines[lines.index("peak torque [N m]") + 2].split()[:2] == ["joint", "2"]
    assert "ECI (81) [(N m)²]" not in lines
    assert next(line for line in lines if line.startswith("form")).split() == ["form", "printed", "printed"]
    assert next(line for line in lines if "outside" in line).split()[-2:] == ["0", "0"]
    assert "103.7" in result.stdout and "88.21" in result.stdout
    # The torque travel of a chattering law exceeds 10 000 N m.
    travel = lines[lines.index("torque travel [N m]") + 1].split()
    assert float(travel[-1]) > 1e4 and "e+" not in result.stdout


@pytest.mark.parametrize("each", [False, pytest.param(True, marks=pytest.mark.full)], ids=["one_run", "each_runs"])
def test_compare_without_schemes_option_compares_all_built_in_schemes(each, monkeypatch):
    if not each:
        short = scenarios.load("example-4.1", {"simulation.t1": 0.01})
        first = Rival.simulated(short, short, logged=False)
        monkeypatch.setattr(Rival, "simulated", lambda scenario, judge, *, logged: replace(first, scenario=scenario))
    result = in_process("compare", "example-4.1", "--set", "simulation.t1=0.01", "--json", code=0)
    listed = json.loads(in_process("list", "schemes", "--json").stdout)["schemes"]
    # `sliding_mode` has no default parts, so it cannot be compared by its name.
    assert list(json.loads(result.stdout)["schemes"]) == [name for name in listed if name != "sliding_mode"]


def test_exit_code_is_3_if_no_run_reaches_its_end():
    bad = ("compare", "example-4.1", *SHORT, *HASTY, "--schemes")
    result = in_process(*bad, "cftsmppc,ftsmppc", code=3)
    assert "none of the runs reached its end inside its envelope" in result.stderr
    assert "cftsmppc: " in result.stdout


@pytest.mark.full
def test_exit_code_is_0_if_one_run_reaches_its_end(tmp_path):
    """One scheme has an envelope that narrows too soon; the other has no envelope."""
    file, out = tmp_path / "hasty.yaml", tmp_path / "out"
    hasty = scenarios.load("example-4.1", {"scheme.performance.deadline": 0.05, "simulation.t1": 0.5})
    file.write_text(as_yaml(hasty.description), encoding="utf-8")
    result = in_process("compare", str(file), "--schemes", "cftsmppc,ftsmc", "--out", str(out), code=0)
    actual = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert actual["schemes"]["cftsmppc"]["outcome"] != "ok"
    assert actual["schemes"]["ftsmc"]["outcome"] == "ok" and "cftsmppc: " in result.stdout
    assert "The report is in" in result.stdout and (out / "report.html").exists()


def test_compare_uses_the_sampled_data_form_of_each_scheme_at_1_khz():
    names = "cftsmppc,ftsmppc,ftsmc,sfsmc,slotine_li,computed_torque"
    result = in_process("compare", "example-4.1-1khz", "--schemes", names, "--json", code=0)
    schemes = json.loads(result.stdout)["schemes"]
    assert ",".join(schemes) == names and {each["outcome"] for each in schemes.values()} == {"ok"}
    errors = {name: max(each["metrics"]["steady_error"]) for name, each in schemes.items()}
    forms = {name: each["form"] for name, each in schemes.items()}
    assert set(forms.values()) == {"sampled-data"}
    # Schemes without an envelope are compared with the scenario's envelope; the estimator keeps them inside.
    assert {each["samples_outside"] for each in schemes.values()} == {0} and max(errors.values()) < 3e-6
    # Textbook computed torque has neither an estimator nor a prediction.
    changes = ("--schemes", "computed_torque", "--set", "scheme.sampled_data=null")
    (printed,) = json.loads(in_process("compare", "example-4.1-1khz", *changes, "--json").stdout)["schemes"].values()
    assert printed["form"] == "printed" and printed["samples_outside"] > 1000
    assert max(printed["metrics"]["steady_error"]) > 1e-3
    assert [schemes[name]["metrics"]["envelope_violations"] for name in ("cftsmppc", "ftsmppc")] == [0, 0]


def test_a_run_that_left_its_envelope_and_returned_does_not_count_as_good():
    outside = ("--set", "start.q=[-0.8,2.9]", "--set", "simulation.t1=2")
    result = in_process("compare", "example-4.1-1khz", "--schemes", "cftsmppc,ftsmppc", *outside, "--json", code=3)
    actual = json.loads(result.stdout)["schemes"]["ftsmppc"]
    assert actual["outcome"] == "recovered" and 0 < actual["stopped"]["back"] < 2


def test_progress_bar_shows_the_running_scheme_on_terminals_only():
    from rich.console import Console

    from slidax.cli.common import stage_bar

    with pytest.MonkeyPatch.context() as patch:
        shown = io.StringIO()
        patch.setattr("rich.console.Console", lambda **_: Console(file=shown, force_terminal=True, width=100))
        with stage_bar() as begin:
            begin("cftsmppc", 2)
            begin("pid", 2)
        assert "pid" in shown.getvalue() and "1/2" in shown.getvalue()
        piped = io.StringIO()
        patch.setattr("rich.console.Console", lambda **_: Console(file=piped))
        with stage_bar() as begin:
            begin("cftsmppc", 2)
        assert piped.getvalue() == ""
