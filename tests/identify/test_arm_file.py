"""An identified arm as a file, from the command line and in a scenario."""

import json

import numpy as np
import pytest
from ruamel.yaml import YAML

import slidax as sx
from slidax.core.errors import DefinitionError
from slidax.identify import identify, write_arm
from slidax.scenarios import named_robot
from tests.cli.commands import in_process
from tests.identify.recorded import recorded, true_arm

ARM = {"kind": "ur5e"}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identified")
    result = identify(recorded(true_arm(), offset=0.1), sx.arms.ur5e())
    write_arm(result, ARM, folder / "arm.yaml")
    return result, folder / "arm.yaml"


def test_arm_file_has_each_parameter_and_its_uncertainty_set(written):
    result, path = written
    data = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    with_path = [parameter for parameter in result.parameters if parameter.path]
    # Rotor, Coulomb and viscous friction of 6 joints, and 10 of the payload.
    assert len(with_path) == 28
    for parameter in with_path:
        place = data["robot"]
        for key in parameter.path.split("."):
            place = place[int(key)] if isinstance(place, list) else place[key]
        assert place == pytest.approx(parameter.value, rel=1e-8, abs=1e-12)
    assert set(data["uncertainty"]) == {"robot.plant.inertial", "robot.plant.coulomb", "robot.plant.viscous"}
    assert len(data["torque_offset"]["value"]) == 6


def test_a_scenario_uses_an_arm_file_as_its_robot(written):
    result, path = written
    scenario = sx.scenarios.load("ur5e-payload", {"robot.kind": "identified", "robot.file": str(path)})
    nominal, true = scenario.controller.nominal, scenario.plant.robot
    np.testing.assert_allclose(nominal.armature, result.robot.armature, rtol=1e-8)
    np.testing.assert_allclose(nominal.payload.center, result.robot.payload.center, rtol=1e-7)
    np.testing.assert_allclose(nominal.payload.inertia, result.robot.payload.inertia, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(true.coulomb, result.robot.coulomb, rtol=1e-8)
    # Values in the scenario replace those of the file, and no others.
    changes = {"robot.kind": "identified", "robot.file": str(path), "robot.plant": {"viscous": 2.0}}
    other = sx.scenarios.load("ur5e-payload", changes).plant.robot
    np.testing.assert_allclose(other.viscous, 2.0)
    np.testing.assert_allclose(other.coulomb, result.robot.coulomb, rtol=1e-8)


def test_identified_links_are_read_back_from_the_arm_file(tmp_path):
    result = identify(recorded(true_arm()), sx.arms.ur5e(), links=True)
    write_arm(result, ARM, tmp_path / "arm.yaml")
    arm, _ = named_robot(str(tmp_path / "arm.yaml"))
    for name in ("masses", "centers", "inertias"):
        np.testing.assert_allclose(getattr(arm, name), getattr(result.robot, name), rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1", "has no mapping `robot` with a `kind`"),
        ("robot: {kind: identified, file: arm.yaml}", "a reference to another file"),
        ("robot: {kind: ur5e, nominal: {links: {mass: [1.0]}}}", "nominal.links.center"),
        ("robot: {kind: two_link, plant: {lengths: [1, 1], masses: [1, 1], inertias: [1, 1]}}", "arm of rigid links"),
    ],
)
def test_a_file_that_is_no_robot_is_refused(tmp_path, text, words):
    (tmp_path / "arm.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(DefinitionError, match=words):
        sx.scenarios.load("ur5e-payload", {"robot.kind": "identified", "robot.file": str(tmp_path / "arm.yaml")})


def test_excite_writes_a_motion_and_identify_writes_an_arm_file_from_a_log(tmp_path, monkeypatch):
    from slidax.identify import excitation

    monkeypatch.setattr(excitation, "STARTS", 3)
    monkeypatch.setattr(excitation, "STEPS", 5)
    monkeypatch.chdir(tmp_path)
    result = in_process("excite", "ur5e", "--seed", "1", "--out", "motion.csv", "--json")
    assert result.exit_code == 0 and json.loads(result.output)["duration"] == 20.0
    log = recorded(true_arm())
    titles = ["time", *(f"{kind}_{i + 1}" for kind in ("q", "tau") for i in range(6))]
    rows = np.column_stack([log.t, log.q, log.tau])
    np.savetxt("log.csv", rows, delimiter=",", header=",".join(titles), comments="")
    command = ("identify", "log.csv", "--robot", "ur5e", "--out", "arm.yaml", "--report", "report", "--json")
    result = in_process(*command)
    assert result.exit_code == 0, result.output
    answer = json.loads(result.output)
    assert set(answer["torque_rms"]) == {"fit", "held_out"} and len(answer["measured_rms"]) == 6
    (mass,) = (parameter for parameter in answer["parameters"] if parameter["name"] == "payload.mass")
    assert mass["value"] == pytest.approx(1.4, abs=4 * mass["standard_error"])
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "payload.mass" in page and "held-out part" in page and "<svg" in page
    again = in_process("identify", "log.csv", "--robot", "arm.yaml", "--no-rotors", "--payload-as", "ur")
    assert again.exit_code == 0 and "armature" not in again.output
    mass = float(again.output.split("set_target_payload(")[1].split(",")[0])
    assert mass == pytest.approx(1.4, abs=0.05)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("identify", "none.csv", "--robot", "ur5e"), "cannot read the file"),
        (("identify", "none.csv", "--robot", "ur5"), "did you mean `ur5e`?"),
        (("identify", "none.csv", "--robot", "ur5e", "--payload-as", "frank"), "did you mean `franka`?"),
        (("excite", "ur5e", "--out", "no/such/motion.csv", "--share", "2"), "`share`"),
    ],
)
def test_invalid_identify_and_excite_commands_print_a_single_line_and_exit_with_2(command, words):
    result = in_process(*command)
    assert result.exit_code == 2 and words in result.output and len(result.output.strip().splitlines()) == 1
