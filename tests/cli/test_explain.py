import json

from tests.cli.commands import in_process

TOO_LIGHT = [
    "example-4.1-1khz",
    *("--set", "robot.nominal.inertias=[0.3, 0.3]", "--set", "robot.nominal.masses=[0.1, 0.1]"),
    # With adaptation the law would learn the arm's inertia and the run would hold.
    *("--set", "scheme.sampled_data.adaptation=null", "--set", "simulation.t1=1.5"),
]


def test_a_saved_run_is_explained_and_its_remedy_is_a_valid_command(tmp_path):
    ran = in_process("run", *TOO_LIGHT, "--out", str(tmp_path), code=3)
    assert "the model error is" in ran.stderr.partition("Most likely")[0]
    assert "Most likely: joint 2" in ran.stderr and "tried successfully" in ran.stderr
    assert "Most likely: joint 2" in (tmp_path / "report.html").read_text(encoding="utf-8")
    answer = in_process("explain", str(tmp_path), "--json", code=0)
    first = json.loads(answer.stdout)["causes"][0]
    assert {"name", "joint", "evidence", "remedy", "tried"} <= first.keys()
    assert (first["name"], first["joint"], first["tried"], first["holds"]) == ("inertia", 2, True, True)
    remedy = [f"--set={path}={json.dumps(value)}" for path, value in first["changes"].items()]
    assert in_process("run", *TOO_LIGHT, *remedy).exit_code == 0
