import json

from tests.analysis.test_explain import UNLEARNT
from tests.cli.commands import in_process

LIGHT = [
    *("--set", "robot.nominal.armature=0.01", "--set", "robot.plant.armature=0.1"),
    *(word for path in UNLEARNT for word in ("--set", f"{path}=null")),
]


def test_a_saved_run_is_explained_and_its_remedy_is_a_valid_command(tmp_path):
    ran = in_process("run", "panda-payload", *LIGHT, "--out", str(tmp_path), code=3)
    assert "Most likely: joint 7" in ran.stderr and "tried, the run holds" in ran.stderr
    assert "Most likely: joint 7" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "its loop is stable for" in ran.stderr.partition("left its envelope")[0]
    answer = in_process("explain", str(tmp_path), "--json", code=0)
    first = json.loads(answer.stdout)["causes"][0]
    assert {"name", "joint", "evidence", "remedy", "tried"} <= first.keys()
    assert (first["name"], first["joint"], first["tried"], first["holds"]) == ("inertia", 7, True, True)
    remedy = [f"--set={path}={json.dumps(value)}" for path, value in first["changes"].items()]
    assert in_process("run", "panda-payload", *LIGHT, *remedy).exit_code == 0
