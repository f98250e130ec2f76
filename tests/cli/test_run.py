import json
import re
from pathlib import Path

import numpy as np
import pytest

from .commands import in_process, own_process


def answered(*arguments, code=0):
    result = in_process("run", *arguments, "--json")
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)


def test_example_4_1_reproduces_its_reference_metrics():
    answer = answered("example-4.1")
    metrics = answer["metrics"]
    assert answer["outcome"] == "ok" and answer["stopped"] is None
    np.testing.assert_allclose(metrics["settling_time"]["1e-3"], [1.000, 0.891], atol=0.002)
    np.testing.assert_allclose(metrics["steady_error"], [2.425e-7, 4.363e-7], rtol=0.02)
    np.testing.assert_allclose(metrics["peak_torque"], [103.653, 97.039], rtol=5e-4)
    np.testing.assert_allclose(metrics["initial_torque"], [103.653, 97.039], rtol=5e-4)
    np.testing.assert_allclose(metrics["iae"], [0.23655, 0.18742], rtol=0.001)
    printed = metrics["paper"]
    np.testing.assert_allclose(printed["aice"], [1543.1, 1552.5], rtol=0.01)
    np.testing.assert_allclose(printed["iae"], [0.2185, 0.4156], rtol=0.01)
    np.testing.assert_allclose(printed["eci"], [1.0111e7, 1.3003e7], rtol=0.01)
    assert metrics["envelope_violations"] == 0 and min(metrics["envelope_margin"]) > 0


def test_example_4_2_reproduces_its_reference_metrics():
    metrics = answered("example-4.2")["metrics"]
    np.testing.assert_allclose(metrics["steady_error"], [5.04e-7, 6.58e-7, 7.80e-7], rtol=0.01)
    np.testing.assert_allclose(metrics["peak_torque"], [9.54, 8.65, 14.43], rtol=0.001)


def test_the_json_has_every_documented_field():
    answer = answered("example-4.1", "--set", "simulation.t1=0.1")
    assert list(answer) == [
        *("scenario", "robot", "scheme", "n", "period", "t1", "outcome", "stopped", "metrics", "timing")
    ]
    assert (answer["scenario"], answer["robot"], answer["scheme"]) == ("example-4.1", "two_link", "cftsmppc")
    assert (answer["n"], answer["period"], answer["t1"]) == (2, 1e-4, 0.1)
    assert list(answer["metrics"]["settling_time"]) == ["1e-2", "1e-3", "1e-4", "1e-5", "1e-8"]
    assert answer["timing"]["steps"] == 1000
    assert all(answer["timing"][key] >= 0 for key in ("import_s", "compile_s", "run_s"))
    per_joint = [value for value in answer["metrics"].values() if isinstance(value, list)]
    assert len(per_joint) == 11 and all(len(value) == 2 for value in per_joint)
    assert list(answer["metrics"]["paper"]) == ["iae", "eci", "aice"]


@pytest.mark.parametrize("mode", ["continuous", pytest.param("held", marks=pytest.mark.full)])
def test_a_run_that_leaves_its_envelope_exits_with_3_without_nan(mode):
    result = own_process(
        "run", "example-4.1", "--json", "--set", "simulation.period=1e-3", "--set", f"simulation.mode={mode}"
    )
    assert result.returncode == 3
    answer = json.loads(result.stdout, parse_constant=lambda word: pytest.fail(f"{word} in the JSON"))
    assert answer["outcome"] == "left_envelope" and answer["stopped"]["joint"] == 1
    assert abs(answer["stopped"]["error"]) >= abs(answer["stopped"]["bound"]) > 0
    assert 4.5 < answer["stopped"]["t"] < 6.0 and answer["metrics"]["steady_error"] is None
    assert answer["metrics"]["peak_torque"][0] > 0
    assert "Joint 1 left its envelope at t = " in result.stderr


def test_another_scheme_by_name_replaces_the_files_scheme():
    answer = answered("example-4.1", "--set", "scheme.reaching.layer=0.05", "--set", "scheme.name=ftsmc")
    assert (answer["scheme"], answer["outcome"]) == ("ftsmc", "ok")
    assert answer["metrics"]["envelope_violations"] is None
    np.testing.assert_allclose(answer["metrics"]["steady_error"], [1.99e-4, 3.77e-4], rtol=0.01)


def test_a_run_that_left_its_envelope_and_returned_exits_with_3_and_reports_both():
    result = in_process(
        *("run", "example-4.1-1khz", "--json", "--set", "start.q=[-0.8,2.9]", "--set", "simulation.t1=4"), code=3
    )
    answer = json.loads(result.stdout)
    stopped = answer["stopped"]
    assert answer["outcome"] == "recovered"
    assert list(stopped) == ["message", "t", "joint", "error", "bound", "back", "beyond"]
    assert stopped["t"] == 0.0 and 0.1 < stopped["back"] < 1.5
    # e(0) is (-1, 0.9) and the bounds are -0.8 and 0.6: joint 2 is farther outside.
    assert (stopped["joint"], stopped["bound"]) == (2, 0.6) and stopped["error"] == pytest.approx(0.9)
    assert stopped["beyond"] >= 0.3 - 1e-9
    assert answer["metrics"]["envelope_violations"] == round(stopped["back"] / 1e-3)
    assert max(answer["metrics"]["steady_error"]) < 1e-2 and result.stderr.startswith(stopped["message"])
    assert "Joint 2 was outside its envelope from the start" in result.stderr
    assert "was back for good at t = " in result.stderr


def test_a_run_that_ends_outside_its_envelope_exits_with_3_and_reports_no_return():
    answer = answered("example-4.1-1khz", "--set", "start.q=[-0.8,2.9]", "--set", "simulation.t1=0.1", code=3)
    assert answer["outcome"] == "left_envelope" and answer["stopped"]["back"] is None
    assert answer["stopped"]["beyond"] > 0 and answer["metrics"]["envelope_violations"] == 101


def test_run_table_shows_samples_outside_the_envelope_and_the_steady_torque_step():
    result = in_process("run", "example-4.1-1khz", "--set", "start.q=[-0.8,2.9]", "--set", "simulation.t1=4", code=3)
    assert re.search(r"✗ Joint 2 was outside its envelope from the start", result.stdout)
    assert re.search(r"4001 samples, [1-9]\d* outside the envelope", " ".join(result.stdout.split()))
    assert "torque step, steady [N m]" in result.stdout and "rms" not in result.stdout


def test_a_run_prints_its_verdict_before_its_numbers_within_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = in_process("run", "example-4.2", "--set", "simulation.t1=2").stdout.splitlines()
    verdict = next(k for k, line in enumerate(lines) if line.startswith("✓ Inside the envelope. Closest: joint 3, "))
    assert verdict < next(k for k, line in enumerate(lines) if line.startswith("settled"))
    assert "42 % of its bound" in lines[verdict] and max(map(len, lines)) <= 80


def test_long_option_also_prints_the_papers_index_sums():
    short, long = (
        in_process("run", "example-4.1", "--set", "simulation.t1=0.01", *form).stdout for form in ((), ("--long",))
    )
    assert "ECI (81)" in long and "ECI (81)" not in short


def test_another_scheme_by_name_keeps_the_sampled_data_form_of_the_file():
    answer = answered("example-4.1-1khz", "--set", "scheme.name=ftsmc", "--set", "simulation.t1=2")
    assert (answer["scheme"], answer["outcome"], answer["stopped"]) == ("ftsmc", "ok", None)
    # The printed form would command 88 N m at the first sample; the drive adds 4 N m to the gravity torque.
    assert answer["metrics"]["initial_torque"] == pytest.approx([12.1158 + 4, 5.93699 + 4], abs=1e-3)
    assert max(answer["metrics"]["max_torque_step"]) <= 4.0 + 1e-9


@pytest.mark.filterwarnings("default::slidax.DefinitionWarning")
def test_a_warning_of_a_robot_file_is_one_line_and_the_run_goes_on(tmp_path):
    urdf = (Path(__file__).parents[2] / "examples" / "robots" / "two_link.urdf").read_text(encoding="utf-8")
    limit = '<limit lower="-4" upper="4" effort="0" velocity="9"/>'
    file = tmp_path / "arm.urdf"
    file.write_text(urdf.replace('type="continuous">', f'type="revolute">{limit}'), encoding="utf-8")
    robot = f"robot={{kind: urdf, file: {file}, nominal: {{gravity: [0, -9.8, 0], armature: [5, 5]}}}}"
    result = in_process("run", "example-4.1", "--set", robot, "--set", "simulation.t1=0.01", "--json", code=0)
    assert json.loads(result.stdout)["outcome"] == "ok"
    message = "the file has no limit of effort for shoulder, elbow, or a limit of 0; such limits are taken as infinite"
    assert result.stderr == f"slidax: warning: {file}: {message}\n"


def test_failed_run_with_a_remedy_in_its_outcome_prints_no_further_diagnosis():
    result = in_process("run", "example-4.1-1khz", "--set", "scheme.sampled_data=null", code=3)
    assert "use its sampled-data form" in " ".join(result.stdout.split()) and result.stderr == ""


def test_report_shows_when_a_run_left_and_reentered_its_envelope(tmp_path):
    arguments = ("--set", "start.q=[-0.8,2.9]", "--set", "simulation.t1=1.5", "--out", str(tmp_path))
    in_process("run", "example-4.1-1khz", *arguments, code=3)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "outcome bad" in text and "was back for good at" in text
    assert "outside: recover" in " ".join(text.split())


@pytest.mark.full
@pytest.mark.parametrize(("columns", "tables"), [(120, [7]), (80, [4, 3])])
def test_seven_joints_fit_on_a_terminal_under_their_own_names(monkeypatch, columns, tables):
    monkeypatch.setenv("COLUMNS", str(columns))
    result = in_process("run", "panda-payload", "--set", "simulation.t1=0.05")
    lines = result.stdout.splitlines()
    heads = [line.split() for line in lines if line.strip().startswith("joint")]
    assert [len(head) for head in heads] == tables
    assert [name for head in heads for name in head] == [f"joint{i + 1}" for i in range(7)]
    assert all(len(line) <= columns for line in lines)
    # The paper's sums are shown for its examples only.
    assert "(80)" not in in_process("run", "panda-payload", "--set", "simulation.t1=0.05", "--long").stdout
    assert "IAE (80) [rad]" in in_process("run", "example-4.1", "--set", "simulation.t1=0.01", "--long").stdout


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_rejected_measurements_are_counted_in_one_line(form):
    slow = ("--set", "scheme.sampled_data.gate.speed=0.2", "--set", "simulation.t1=0.5")
    result = in_process("run", "example-4.1-1khz", *slow, *form)
    lines = [line for line in result.stderr.splitlines() if "gate rejected" in line]
    assert len(lines) == 1
    number = re.search(r"rejected (\d+) of 501 measurements", lines[0])
    assert number is not None and 0 < int(number[1]) < 501


def test_a_run_without_rejected_measurements_has_no_line_about_them():
    assert "rejected" not in in_process("run", "example-4.1-1khz", "--set", "simulation.t1=0.5").output
