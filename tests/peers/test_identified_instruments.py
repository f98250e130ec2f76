"""Offsets of encoders and maps of actuators, identified from logs of arms that Pinocchio moves."""

import itertools
import json
import math

import equinox as eqx
import numpy as np
import pytest
from ruamel.yaml import YAML

import slidax as sx
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import JointLog, identify, write_arm
from slidax.identify.instruments import CROSSTALK, GAIN, OFFSET
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


RATE, NOISE = 125.0, 0.01
"""Samples per second [Hz], and torque noise as a share of each joint's root mean square."""


def moved_arm(name, seed):
    """An arm with a random tool, Pinocchio's model of it, and a motion for 12 s."""
    rng = np.random.default_rng(seed)
    arm = random_tool(name, 3.0, rng)
    model = with_tool(name, arm.payload)
    model.armature = np.array(arm.armature)
    return arm, model, *moved(12.0, RATE, arm.joints, size=1.0, seed=seed), rng


def torques(arm, model, motion):
    data = model.createData()
    tau = np.stack([pinocchio.rnea(model, data, *row) for row in zip(*motion, strict=True)])
    return tau + motion.dq * np.asarray(arm.viscous) + np.sign(motion.dq) * np.asarray(arm.coulomb)


def pinocchio_log(name, seed, offset=0.0, gains=None, noise=0):
    """An arm with a random tool, and its log by encoders with an offset and drives with `τ = gains τ_log`.

    Logs of the same motion have another `noise`.
    """
    arm, model, t, motion, rng = moved_arm(name, seed)
    tau = torques(arm, model, motion)
    tau = tau if gains is None else np.linalg.solve(gains, tau.T).T
    tau += NOISE * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=(noise + 1, *tau.shape))[-1]
    return arm, JointLog("a log", arm.joint_names, t, 1e-5 * np.round((motion.q - offset) / 1e-5), tau)


def sliding(velocity, reach):
    """True beyond a distance of `reach` samples, or half of it and so on, from the reversals of a joint.

    Dry friction may stick there, so that `identify` uses no such row while a fifth of the rows is left.
    """
    slow = np.abs(velocity) < 0.03 * np.abs(velocity).max()
    kept = (np.convolve(slow, np.ones(2 * (reach // 2**k) + 1), "same") < 0.5 for k in itertools.count())
    return next(rows for rows in kept if rows.mean() > 0.2)


def least_errors(name, seed, result, kind, prior, gains=None, payload=False):
    """Cramér-Rao bound of the standard errors, from Pinocchio's regressors and the rows that `identify` may use.

    The fitted part of the log has white noise and unknown rotors, friction and offsets of the torques.

    - `kind`: `encoder_offset`, `gain` or `full`.
    - `prior`: prior standard deviations of the unknowns of this kind.
    - `payload`: True if the payload is unknown.
    """
    arm, model, _, motion, _ = moved_arm(name, seed)
    n, data, fitted = arm.joints, model.createData(), [part[: len(motion.q) * 3 // 4] for part in motion]
    gains = np.eye(n) if gains is None else gains
    tau, mixing, units = torques(arm, model, motion), np.linalg.inv(gains), np.eye(n)
    sigma = NOISE * np.sqrt(np.mean((tau @ mixing.T) ** 2, axis=0))
    reach = math.ceil(RATE / result.logs[0].cut_off)
    weight = np.stack([sliding(column, reach) for column in motion.dq.T], axis=1)[: len(fitted[0])] / sigma
    q, dq, ddq = fitted
    others = [basis[:, :, None] * units for basis in (ddq, dq, np.sign(dq), np.ones_like(dq))]
    states = list(zip(*fitted, strict=True))
    # Pinocchio returns the same memory each time, to be copied.
    if payload:
        # A tool on the last link has the parameters of this link, in another frame.
        bodies = [pinocchio.computeJointTorqueRegressor(model, data, *row)[:, -10:].copy() for row in states]
        others.append(np.stack(bodies))
    if kind == "encoder_offset":
        own = np.stack([pinocchio.computeRNEADerivatives(model, data, *row)[0].copy() for row in states])
    else:
        pairs = [(i, j) for i in range(n) for j in range(n) if kind == "full" or i == j]
        own = np.stack([tau[: len(q), j, None] * units[i] for i, j in pairs], axis=2)
    columns = np.concatenate([own, *(mixing @ part for part in others)], axis=2) * weight[:, :, None]
    columns, m = columns.reshape(-1, columns.shape[2]), own.shape[2]
    scale = np.append(prior, 1.0 / np.linalg.norm(columns[:, m:], axis=0))
    information = (columns * scale).T @ (columns * scale) + np.diag([1.0] * m + [1e-12] * (len(scale) - m))
    covariance = (np.linalg.inv(information) * np.outer(scale, scale))[:m, :m]
    if kind != "encoder_offset":
        # The unknowns are of E = G⁻¹ - 1: dG = -G dE G.
        slope = np.array([[-gains[a, i] * gains[j, b] for i, j in pairs] for a, b in pairs])
        covariance = slope @ covariance @ slope.T
    return np.sqrt(np.diag(covariance))


def assert_as_sure_as_possible(deviations, least):
    """Standard errors are at least those of the Cramér-Rao bound, and at most three times as large.

    They are estimates that scatter, and so may be 20 % below the bound. The filter's band and the unknown delay of the
    torques cost up to a factor of 2.6 in 8 to 20 logs of each motion here.
    """
    assert (deviations > 0.8 * least).all() and (deviations < 3.0 * least).all(), deviations / least


MORE = [
    pytest.param(name, seed, marks=pytest.mark.full) for name in ("panda", "ur5e", "iiwa14", "gen3") for seed in (2, 3)
]

CLEAR = 2
"""Logs of lower seeds determine each inner joint precisely.

In the others, joints reverse so often or carry so little that the equations between the reversals show some offsets and
gains poorly: to 10 mrad and to 6 % at best.
"""


def some_offset(joints, seed):
    return np.random.default_rng(50 + seed).uniform(-0.04, 0.04, joints)


@pytest.mark.parametrize(("name", "seed"), [("ur5e", 0), ("panda", 1), *MORE])
def test_encoder_offsets_are_identified_where_gravity_makes_them_observable(name, seed):
    known = getattr(sx.arms, name)()
    offset = some_offset(known.joints, seed)
    arm, log = pinocchio_log(name, seed, offset)
    result = identify(log, known, encoder_offset=True)
    errors, deviations = result.values("encoder_offset") - offset, result.standard_errors("encoder_offset")
    prior = np.full(known.joints, OFFSET["rad"])
    # The first axis is vertical. The last joint turns the unknown payload, whose position is unknown too.
    assert (np.abs(errors) < 3.5 * deviations)[1:-1].all()
    least = least_errors(name, seed, result, "encoder_offset", prior, payload=True)
    assert_as_sure_as_possible(deviations[1:-1], least[1:-1])
    assert deviations[1:-1].max() < 0.01 or seed >= CLEAR
    unseen = [parameter.joint for parameter in result.unseen if parameter.name == "encoder_offset"]
    assert {known.joint_names[0], known.joint_names[-1]} <= set(unseen)
    assert unseen == [joint for joint, error in zip(known.joint_names, deviations, strict=True) if error > 0.01]
    lines = {line.split("  ")[0]: line for line in str(result).splitlines()}
    ends = [lines[f"encoder_offset of {joint}"].split("  ")[-1] for joint in unseen]
    assert ends[0] == ends[-1] == "not seen" and set(ends[1:-1]) <= {"poorly seen"}
    plain = identify(log, known)
    held_out, without = (each.held_out_rms[1:-1] for each in (result, plain))
    assert (held_out < without).all() or seed >= CLEAR
    # Dry friction at a standstill is in both errors, and may be larger than what the offsets explain.
    floor = NOISE * np.sqrt(np.mean(log.tau**2, axis=0) * 2.0 * result.logs[0].cut_off / RATE)[1:-1]
    assert (held_out < without + 2.0 * floor).all()
    assert np.linalg.norm(held_out / floor) < np.linalg.norm(without / floor)
    # A known payload makes the last joint's offset observable.
    carries = eqx.tree_at(lambda robot: robot.payload, known, arm.payload)
    last = identify(log, carries, encoder_offset=True, payload=False)
    deviation = last.standard_errors("encoder_offset")[-1]
    assert abs(last.values("encoder_offset") - offset)[-1] < 3.5 * deviation
    assert_as_sure_as_possible(deviation, least_errors(name, seed, last, "encoder_offset", prior)[-1])
    assert deviation < 0.01 or seed >= CLEAR


def test_identified_encoder_offsets_reach_the_laws_model_through_the_arm_file(tmp_path):
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
    prior = np.where(np.eye(known.joints), GAIN, CROSSTALK).ravel()
    inside = []
    # Errors within a row of one log are correlated, so the share inside the intervals needs several logs.
    for noise in range(1 if seed < CLEAR else 4):
        arm, log = pinocchio_log(name, seed, gains=gains, noise=noise)
        carries = eqx.tree_at(lambda robot: robot.payload, known, arm.payload)
        full = identify(log, carries, actuator_map="full", payload=False)
        values, deviations = full.actuator_map
        assert (np.abs(values - gains) < 4.0 * deviations).all()
        inside.append(np.abs(values - gains) < 1.96 * deviations)
        least = least_errors(name, seed, full, "full", prior, gains)
        # The factor is up to 3.7 in 8 to 20 logs of each motion.
        assert 0.8 * np.median(least) < np.median(deviations) < 4.0 * np.median(least)
        assert np.median(deviations) < 0.01 or seed >= CLEAR
    assert np.mean(inside) > 0.9
    diagonal = np.diag(np.diag(gains))
    _, log = pinocchio_log(name, seed, gains=diagonal)
    result = identify(log, known, actuator_map="gain")
    off, deviations = result.values("gain") - np.diag(gains), result.standard_errors("gain")
    assert (np.abs(off) < 4.0 * deviations).all()
    least = least_errors(name, seed, result, "gain", np.full(known.joints, GAIN), diagonal, payload=True)
    assert_as_sure_as_possible(deviations, least)
    assert np.abs(off).max() < 0.02 or seed >= CLEAR
    assert abs(result.values("payload.mass")[0] - arm.payload.mass) < 4.0 * result.standard_errors("payload.mass")[0]


def test_a_poorly_observable_gain_is_reported_with_its_interval_and_a_warning():
    gains = np.diag(np.diag(some_gains(7, 3)))
    _, log = pinocchio_log("panda", 3, gains=gains)
    result = identify(log, sx.arms.panda(), actuator_map="gain")
    (weak,) = result.unseen
    assert weak.label == "gain of panda_joint7" and 0.1 * GAIN < weak.standard_error < 0.5 * GAIN
    low, high = weak.interval()
    # The value differs from its prior, 1, and the interval is narrower.
    assert low < gains[6, 6] < high and abs(weak.value - 1.0) > 0.05
    line = next(line for line in str(result).splitlines() if line.startswith(weak.label))
    assert line.endswith("  poorly seen")
    assert any(f"shows `{weak.label}` poorly: trust the interval" in sentence for sentence in result.warnings)


def test_identify_prints_the_actuator_map_and_writes_it_to_the_arm_file(tmp_path):
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


def test_an_actuator_map_is_refused_for_an_unknown_kind_or_unknown_masses_or_exchanged_torques():
    _, log = pinocchio_log("ur5e", 0)
    with pytest.raises(DefinitionError, match="needs known masses"):
        identify(log, sx.arms.ur5e(), actuator_map="gain", links=True)
    with pytest.raises(DefinitionError, match="must be `gain` or `full`"):
        identify(log, sx.arms.ur5e(), actuator_map="diagonal")
    swapped = JointLog("a log", log.joints, log.t, log.q, log.tau[:, [0, 2, 1, 3, 4, 5]])
    with pytest.raises(DefinitionError, match=r"joint 3 in a log .* would be 2.54, too far from 1 for a drive"):
        identify(swapped, sx.arms.ur5e(), actuator_map="full")
