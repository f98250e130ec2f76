"""Offsets of encoders and maps of actuators, identified from logs of arms that Pinocchio moves."""

import json

import equinox as eqx
import numpy as np
import pytest
from ruamel.yaml import YAML

import slidax as sx
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import JointLog, identify, write_arm
from slidax.scenarios import named_robot
from tests.cli.commands import in_process
from tests.identify.recorded import moved
from tests.identify.test_identify import random_tool
from tests.peers.by_pinocchio import pinocchio
from tests.peers.ready_arms import for_pinocchio


def with_tool(name, tool):
    """Pinocchio's arm with a payload."""
    model = for_pinocchio(name)
    tip = next(frame for frame in model.frames if frame.type == pinocchio.BODY)
    body = pinocchio.Inertia(float(tool.mass), np.array(tool.center), np.array(tool.inertia))
    model.appendBodyToJoint(tip.parentJoint, body, tip.placement)
    return model


def pinocchio_log(name, seed, offset=0.0, gains=None, seconds=12.0, rate=125.0):
    """An arm with a random tool, and its log by encoders with an offset and drives with `τ = gains τ_log`."""
    rng = np.random.default_rng(seed)
    arm = random_tool(name, 3.0, rng)
    model = with_tool(name, arm.payload)
    model.armature, data = np.array(arm.armature), model.createData()
    t, motion = moved(seconds, rate, arm.joints, size=1.0, seed=seed)
    tau = np.stack([pinocchio.rnea(model, data, *row) for row in zip(*motion, strict=True)])
    tau = tau + motion.dq * np.asarray(arm.viscous) + np.sign(motion.dq) * np.asarray(arm.coulomb)
    tau = tau if gains is None else np.linalg.solve(gains, tau.T).T
    tau += 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    return arm, JointLog("a log", arm.joint_names, t, 1e-5 * np.round((motion.q - offset) / 1e-5), tau)


MORE = [
    pytest.param(name, seed, marks=pytest.mark.full) for name in ("panda", "ur5e", "iiwa14", "gen3") for seed in (2, 3)
]


def some_offset(joints, seed):
    return np.random.default_rng(50 + seed).uniform(-0.04, 0.04, joints)


@pytest.mark.parametrize(("name", "seed"), [("ur5e", 0), ("panda", 1), *MORE])
def test_offsets_of_encoders_are_identified_where_gravity_shows_them(name, seed):
    known = getattr(sx.arms, name)()
    offset = some_offset(known.joints, seed)
    arm, log = pinocchio_log(name, seed, offset)
    result = identify(log, known, encoder_offset=True)
    errors, deviations = result.values("encoder_offset") - offset, result.standard_errors("encoder_offset")
    # The first axis is vertical. The last joint turns the unknown payload, whose place is unknown too.
    assert (np.abs(errors) < 3.5 * deviations)[1:-1].all() and deviations[1:-1].max() < 0.01
    unseen = [parameter.joint for parameter in result.unseen if parameter.name == "encoder_offset"]
    assert unseen == [known.joint_names[0], known.joint_names[-1]]
    assert f"encoder_offset of {known.joint_names[0]}" in str(result)
    plain = identify(log, known)
    assert (result.held_out_rms[1:-1] < plain.held_out_rms[1:-1]).all()
    # A known payload shows the last joint's offset.
    carries = eqx.tree_at(lambda robot: robot.payload, known, arm.payload)
    last = identify(log, carries, encoder_offset=True, payload=False)
    assert last.standard_errors("encoder_offset")[-1] < 0.01
    assert abs(last.values("encoder_offset") - offset)[-1] < 3.5 * last.standard_errors("encoder_offset")[-1]


def test_an_arm_file_has_the_offsets_of_its_encoders_and_a_law_uses_them(tmp_path):
    known, offset = sx.arms.ur5e(), some_offset(6, 4)
    arm, log = pinocchio_log("ur5e", 4, offset)
    result = identify(log, known, encoder_offset=True)
    write_arm(result, {"kind": "ur5e"}, tmp_path / "arm.yaml")
    changes = {"robot.kind": "identified", "robot.file": str(tmp_path / "arm.yaml")}
    nominal = sx.scenarios.load("ur5e-payload", changes).controller.nominal
    # Gravity of the true arm, in the positions of the encoders.
    model = with_tool("ur5e", arm.payload)
    data, still = model.createData(), np.zeros(6)
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (10, 6)):
        true = pinocchio.computeGeneralizedGravity(model, data, q + offset)
        np.testing.assert_allclose(nominal.bias(as_array(q), as_array(still)), true, atol=0.2)
        assert np.abs(np.asarray(known.bias(as_array(q), as_array(still))) - true).max() > 0.5
    np.testing.assert_allclose(nominal.limits.lower, known.limits.lower - result.values("encoder_offset"), rtol=1e-6)
    again, _ = named_robot(str(tmp_path / "arm.yaml"))
    np.testing.assert_allclose(again.rotations, result.robot.rotations, atol=1e-7)


def some_gains(joints, seed):
    rng = np.random.default_rng(70 + seed)
    return np.diag(rng.uniform(0.8, 1.2, joints)) + rng.uniform(-0.03, 0.03, (joints, joints)) * (1 - np.eye(joints))


@pytest.mark.parametrize(("name", "seed"), [("iiwa14", 1), *MORE])
def test_gains_and_cross_talk_of_drives_are_identified_to_within_their_intervals(name, seed):
    known = getattr(sx.arms, name)()
    gains = some_gains(known.joints, seed)
    arm, log = pinocchio_log(name, seed, gains=gains)
    carries = eqx.tree_at(lambda robot: robot.payload, known, arm.payload)
    values, deviations = identify(log, carries, actuator_map="full", payload=False).actuator_map
    assert (np.abs(values - gains) < 4.0 * deviations).all()
    assert np.mean(np.abs(values - gains) < 1.96 * deviations) > 0.9 and np.median(deviations) < 0.01
    _, log = pinocchio_log(name, seed, gains=np.diag(np.diag(gains)))
    result = identify(log, known, actuator_map="gain")
    np.testing.assert_allclose(result.values("gain"), np.diag(gains), atol=0.02)
    off = result.values("gain") - np.diag(gains)
    assert (np.abs(off) < 4.0 * result.standard_errors("gain")).all()
    assert abs(result.values("payload.mass")[0] - arm.payload.mass) < 4.0 * result.standard_errors("payload.mass")[0]


def test_a_map_is_written_for_a_scenario_and_shown_on_the_command_line(tmp_path):
    gains = some_gains(6, 0)
    _, log = pinocchio_log("ur5e", 0, gains=gains)
    head = ",".join(["time", *(f"{kind}_{k}" for kind in ("q", "tau") for k in range(1, 7))])
    table = np.column_stack([log.t, log.q, log.tau])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=head, comments="")
    words = ["identify", str(tmp_path / "log.csv"), "--robot", "ur5e", "--actuator-map", "full", "--json"]
    printed = json.loads(in_process(*words, "--out", str(tmp_path / "arm.yaml")).stdout)
    values = {(each["name"], each["joint"]): each["value"] for each in printed["parameters"]}
    data = YAML(typ="safe", pure=True).load(tmp_path / "arm.yaml")
    matrix = np.array(data["actuator"]["map"])
    names = sx.arms.ur5e().joint_names
    assert values["gain", names[1]] == pytest.approx(matrix[1, 1], rel=1e-5)
    assert values["crosstalk_1", names[2]] == pytest.approx(matrix[2, 1], rel=1e-5)
    errors = np.array(data["actuator_map"]["standard_error"])
    assert (np.abs(matrix - gains) < 4.0 * errors).all()


def test_a_map_without_a_known_mass_or_of_interchanged_joints_is_refused_with_the_reason():
    _, log = pinocchio_log("ur5e", 0)
    with pytest.raises(DefinitionError, match="needs known masses"):
        identify(log, sx.arms.ur5e(), actuator_map="gain", links=True)
    with pytest.raises(DefinitionError, match="must be `gain` or `full`"):
        identify(log, sx.arms.ur5e(), actuator_map="diagonal")
    swapped = JointLog("a log", log.joints, log.t, log.q, log.tau[:, [0, 2, 1, 3, 4, 5]])
    with pytest.raises(DefinitionError, match=r"too far from|--torque-order"):
        identify(swapped, sx.arms.ur5e(), actuator_map="full")
