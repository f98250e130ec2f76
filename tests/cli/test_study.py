from types import SimpleNamespace

import pytest

from slidax.cli.tables import print_study
from slidax.studies import frame, monte_carlo
from slidax.studies.study import Section
from tests.documentation.pages import ROOT

from .commands import STUDY, answer_of, in_process

TEXT = STUDY + "runs: 64"


def test_a_study_is_written_and_resumed_and_its_rows_become_scenarios(tmp_path):
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    file.write_text(TEXT, encoding="utf-8")
    answer = answer_of("study", str(file), "--out", str(out))
    assert {"kind", "runs", "failures", "probability", "worst"} <= answer.keys()
    assert (answer["runs"], answer["failures"]) == (64, 0)
    assert answer["worst"]["scenario"] == str(out / "worst.yaml")
    assert {"rows.parquet", "report.html", "results.json", "worst.yaml", "study.json"} <= {
        p.name for p in out.iterdir()
    }

    again = in_process("study", str(file), "--out", str(out), code=2)
    assert "--resume" in again.stderr
    resumed = in_process("study", str(file), "--out", str(out), "--resume", "--runs", "80", code=0)
    assert "80 runs, none failed" in resumed.stdout
    pytest.importorskip("pandas", reason="pandas is not installed")
    rows = frame(out)
    assert rows["row"].tolist() == list(range(80)) and (rows["outcome"] == 0).all()
    assert rows["disturbance.scale"].between(0, 1).all() and rows.attrs["units"]["peak_torque"] == "N m or N"

    assert in_process("study", str(file), "--out", str(out), "--case", "70").exit_code == 0
    assert "truth" in (out / "case-70.yaml").read_text(encoding="utf-8")
    assert in_process("study", str(file), "--out", str(out), "--case", "80").exit_code == 2


def test_ctrl_c_prints_the_command_that_resumes(tmp_path, monkeypatch):
    file = tmp_path / "study.yaml"
    file.write_text(TEXT, encoding="utf-8")

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(monte_carlo.MonteCarlo, "run", interrupted)
    stopped = in_process("study", str(file), "--out", str(tmp_path / "out"))
    assert stopped.exit_code == 130 and "--resume" in stopped.stderr


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["{file}", "--resume"], "--out DIR"),
        (["{file}", "--case", "3"], "--out DIR"),
        (["{file}", "--cluster", "farm"], "local:2"),
    ],
)
def test_invalid_study_commands_are_refused_in_one_line(tmp_path, words, text):
    file = tmp_path / "study.yaml"
    file.write_text(TEXT, encoding="utf-8")
    done = in_process("study", *(word.format(file=file) for word in words), code=2)
    assert text in done.stderr
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.output


def test_sweep_refuses_the_runs_option():
    sweep = ROOT / "examples" / "studies" / "sweep-payload.yaml"
    done = in_process("study", str(sweep), "--runs", "8", code=2)
    assert "a study of the kind `sweep` has no `runs` to set" in done.stderr


def test_a_printed_table_of_a_study_keeps_its_units(capsys):
    section = Section("The front", "", ("Gains", "steady_error [rad]"), [["own", 0.25]])
    print_study(SimpleNamespace(summary="Kept [rad] all.", sections=lambda: [section]))
    shown = capsys.readouterr().out
    assert "steady_error [rad]" in shown and "Kept [rad] all." in shown
