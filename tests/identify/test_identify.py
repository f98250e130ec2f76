"""Identification of an arm whose parameters are known."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from scipy.optimize import nnls

import slidax as sx
from slidax.arms import Payload
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import EstimatedParameter, JointLog, identify, write_arm
from slidax.identify.regressor import JointMotion, parameters_of_body
from slidax.identify.torque_model import UNIT_MASSES
from tests.identify.recorded import PAYLOAD, moved, recorded, true_arm


@pytest.fixture(scope="module")
def identified():
    return identify(recorded(true_arm(), offset=0.2, lag=2e-3), sx.arms.ur5e())


def test_rotors_friction_and_payload_are_identified_up_to_the_noise(identified):
    arm = true_arm()
    for name in ("armature", "coulomb", "viscous"):
        off = identified.values(name) - np.asarray(getattr(arm, name))
        assert (np.abs(off) < 4.0 * identified.standard_errors(name)).all(), name
    np.testing.assert_allclose(identified.values("coulomb"), arm.coulomb, rtol=0.1)
    assert (np.abs(identified.values("offset") - 0.2) < 4.0 * identified.standard_errors("offset")).all()
    np.testing.assert_allclose(identified.values("offset")[3:], 0.2, atol=0.02)
    assert identified.values("payload.mass") == pytest.approx(1.4, rel=0.02)
    center = [identified.values(f"payload.center.{axis}")[0] for axis in "xyz"]
    np.testing.assert_allclose(center, PAYLOAD.center, atol=5e-3)


def test_torque_delay_is_identified(identified):
    (fit,) = identified.logs
    assert fit.lag == pytest.approx(2e-3, abs=5e-4) and abs(fit.lag - 2e-3) < 4.0 * fit.lag_error


def test_identified_arm_has_the_estimates_and_predicts_the_held_out_part(identified):
    np.testing.assert_array_equal(identified.robot.armature, identified.values("armature"))
    assert float(identified.robot.payload.mass) == identified.values("payload.mass")[0]
    assert (identified.held_out_rms < 0.1 * identified.measured_rms).all()
    assert "payload.mass" in str(identified) and "held out" in str(identified)
    assert {parameter.name.split(".")[0] for parameter in identified.unseen} <= {"payload"}


@pytest.mark.full
def test_stribeck_friction_and_torque_ripple_are_identified_if_requested(tmp_path):
    arm = true_arm()
    t, motion = moved(20.0, 250.0, 6)
    log = recorded(arm, times_and_motion=(t, motion), noise=0.002)
    excess, wave = np.array([1.0, 1.2, 0.8, 0.4, 0.3, 0.3]), np.array([0.9, -1.1, 0.7, 0.3, -0.2, 0.2])
    slow = np.exp(-((motion.dq / 0.4) ** 2)) * np.sign(motion.dq)
    tau = log.tau + excess * slow + wave * np.sin(6.0 * motion.q) + 0.5 * wave * np.cos(6.0 * motion.q)
    log = replace(log, tau=tau)
    plain = identify(log, sx.arms.ur5e(), cut_off=12.0)
    full = identify(log, sx.arms.ur5e(), cut_off=12.0, stribeck=0.4, ripple=[6.0])
    assert (full.held_out_rms < 0.7 * plain.held_out_rms).all()
    assert not any(name in str(plain) for name in ("stribeck", "ripple"))
    for name, true in {"stribeck": excess, "ripple_6_sin": wave, "ripple_6_cos": 0.5 * wave}.items():
        np.testing.assert_allclose(full.values(name), true, atol=0.1, err_msg=name)
        assert (np.abs(full.values(name) - true) < 4.0 * full.standard_errors(name)).all(), name
    np.testing.assert_allclose(full.values("coulomb"), arm.coulomb, atol=0.15)
    write_arm(full, {"kind": "ur5e"}, tmp_path / "arm.yaml")
    text = (tmp_path / "arm.yaml").read_text()
    assert "torque_stribeck:" in text and "torque_ripple_6_cos:" in text
    sx.scenarios.load("ur5e-payload", {"robot.kind": "identified", "robot.file": str(tmp_path / "arm.yaml")})


@pytest.mark.parametrize("options", [{"stribeck": -1.0}, {"ripple": [0.0]}, {"ripple": [3.0, 3.0]}])
def test_invalid_stribeck_and_ripple_options_are_refused(options):
    with pytest.raises(DefinitionError, match=f"`{next(iter(options))}` must be"):
        identify(recorded(true_arm()), sx.arms.ur5e(), **options)


def test_confidence_intervals_have_about_their_stated_coverage():
    arm, inside = true_arm(), []
    for seed in range(8):
        result = identify(recorded(arm, seconds=8.0, noise=0.02, seed=seed), sx.arms.ur5e(), cut_off=8.0)
        for name in ("armature", "coulomb", "viscous"):
            off = result.values(name) - np.asarray(getattr(arm, name))
            inside.append(np.abs(off) < 1.96 * result.standard_errors(name))
    assert 0.88 <= np.mean(inside) <= 0.995


@pytest.mark.parametrize("center", [[0.014, 0.005, 0.121], [-0.03, 0.04, 0.06], [0.0, 0.0, 0.18]])
def test_point_masses_of_the_torque_check_can_represent_a_compact_tool(center):
    body = parameters_of_body(2.5, np.array(center), np.diag([0.004, 0.004, 0.003]))
    scale = np.array([1.0, *3 * (0.2,), *6 * (0.04,)])
    weights, residual = nnls((UNIT_MASSES / scale).T, body / scale)
    assert residual < 0.15 * 2.5
    assert weights @ UNIT_MASSES[:, 0] == pytest.approx(2.5, rel=0.02)


def random_tool(name, largest, random):
    """An arm with random rotors and friction, and a random box of at most this mass at its tip."""
    arm = getattr(sx.arms, name)()
    rated = np.asarray(arm.limits.torque)
    mass, sides = random.uniform(0.1, 1.0) * largest, random.uniform(0.03, 0.1, 3)
    payload = Payload(
        mass=mass,
        center=[*random.uniform(-0.05, 0.05, 2), random.uniform(0.03, 0.15)],
        inertia=mass / 3 * np.diag(sides @ sides - sides**2),
    )
    drives = [as_array(random.uniform(*share) * rated) for share in ((1e-3, 3e-3), (0.01, 0.03), (5e-3, 0.02))]
    return eqx.tree_at(lambda x: (x.armature, x.coulomb, x.viscous, x.payload), arm, (*drives, payload))


@pytest.mark.full
def test_201_tools_on_three_arms_are_weighed_within_2_percent_with_valid_intervals():
    inside = []
    for name, largest in (("panda", 3.0), ("ur5e", 5.0), ("iiwa14", 8.0)):
        for seed in range(67):
            arm = random_tool(name, largest, np.random.default_rng(seed))
            motion = moved(20.0, 250.0, arm.joints, size=1.0)
            result = identify(recorded(arm, seed=seed, times_and_motion=motion), getattr(sx.arms, name)())
            mass = float(arm.payload.mass)
            assert result.values("payload.mass")[0] == pytest.approx(mass, rel=0.02), (name, seed)
            truth = [mass, *np.asarray(arm.payload.center)]
            for number, value in zip(("mass", "center.x", "center.y", "center.z"), truth, strict=True):
                off = result.values(f"payload.{number}")[0] - value
                inside.append(abs(off) <= 1.96 * result.standard_errors(f"payload.{number}")[0])
    assert 0.9 <= np.mean(inside) <= 0.99


def short_log(arm, seed, samples=160, rate=100.0):
    """A short log at a low rate, with measured velocities."""
    t, motion = moved(4.0, rate, arm.joints, seed=seed, size=0.8)
    t, motion = t[:samples], JointMotion(*(part[:samples] for part in motion))
    log = recorded(arm, seed=seed, times_and_motion=(t, motion))
    noise = 1e-3 * np.random.default_rng(seed).normal(size=motion.dq.shape)
    return replace(log, q=1e-4 * np.round(motion.q / 1e-4), dq=motion.dq + noise)


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14"])
def test_log_of_160_samples_with_velocities_is_identified_with_wide_intervals_that_hold(name):
    inside, errors = [], []
    for seed in range(4):
        arm = random_tool(name, 3.0, np.random.default_rng(seed))
        result = identify(short_log(arm, seed), getattr(sx.arms, name)())
        for parameter in ("armature", "coulomb", "viscous"):
            off = result.values(parameter) - np.asarray(getattr(arm, parameter))
            inside.extend(np.abs(off) < 1.96 * result.standard_errors(parameter))
        errors.append(result.standard_errors("payload.mass")[0])
        assert abs(result.values("payload.mass")[0] - arm.payload.mass) < 2.5 * errors[-1]
    assert np.mean(inside) > 0.9 and min(errors) < 0.5


def test_a_short_noisy_log_causes_a_warning_and_time_reversed_torques_are_refused():
    arm, random = random_tool("ur5e", 5.0, np.random.default_rng(14)), np.random.default_rng(14)
    log = short_log(arm, 14)
    tau = log.tau + 0.05 * np.sqrt(np.mean(log.tau**2, axis=0)) * random.normal(size=log.tau.shape)
    noisy = replace(log, tau=tau, dq=log.dq + 0.01 * random.normal(size=log.dq.shape))
    assert any("leaves this torque uncertain by" in warning for warning in identify(noisy, sx.arms.ur5e()).warnings)
    with pytest.raises(DefinitionError, match=r"do not fit ur5e|No other sign"):
        identify(replace(log, tau=log.tau[::-1]), sx.arms.ur5e())


def test_parameters_of_a_joint_at_rest_are_reported_as_not_identifiable():
    log = recorded(true_arm(), still=(5,))
    identified = identify(log, sx.arms.ur5e())
    unseen = {(parameter.name, parameter.joint) for parameter in identified.unseen}
    last = sx.arms.ur5e().joint_names[5]
    assert {("armature", last), ("coulomb", last), ("viscous", last)} <= unseen
    assert ("armature", sx.arms.ur5e().joint_names[0]) not in unseen
    (line,) = (line for line in str(identified).splitlines() if line.startswith(f"armature of {last}"))
    assert line.endswith("  not seen")
    assert identified.unseen_directions >= 3


def test_fitting_the_links_of_a_wrong_model_reduces_the_held_out_torque_error():
    arm = true_arm()
    off = identify(recorded(arm), sx.arms.Mismatch(mass_factor=0.8).applied(sx.arms.ur5e()), links=True)
    wrong = identify(recorded(arm), sx.arms.Mismatch(mass_factor=0.8).applied(sx.arms.ur5e()))
    assert (off.held_out_rms[:3] < 0.8 * wrong.held_out_rms[:3]).all()
    # At most 36 combinations of the 60 link parameters affect the torques.
    assert off.unseen_directions >= 10
    for inertia, mass in zip(np.asarray(off.robot.inertias), np.asarray(off.robot.masses), strict=True):
        moments = np.linalg.eigvalsh(inertia)
        assert mass > 0 and moments[0] > 0 and moments[0] + moments[1] >= moments[2] * (1 - 1e-9)


def test_payload_estimate_of_an_empty_hand_is_physically_consistent():
    identified = identify(recorded(sx.arms.ur5e(), noise=0.05), sx.arms.ur5e())
    load = identified.robot.payload
    assert 0.0 <= float(load.mass) < 0.2 and np.linalg.eigvalsh(np.asarray(load.inertia)).min() >= 0.0
    assert (np.asarray(identified.robot.armature) >= 0).all()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"q": 57.3}, "are they degrees"),
        ({"held_out": 0.95}, r"`held_out` must be in \(0, 0.9\]"),
        ({"cut_off": 100.0}, "a quarter of the sampling rate"),
        ({"keep": 90}, "at least 100 are needed"),
        ({"keep": 130, "cut_off": 5.0}, "the part that is fitted has 0.12 s and needs 0.8 s"),
        ({"held_out": 0.03}, "the part that is held out has"),
        ({"dq": 57.3}, "times the slope of `q`"),
        ({"nan": 7}, "is not finite for joint"),
    ],
)
def test_unusable_log_is_refused_with_the_reason(changed, words):
    log = recorded(true_arm())
    k = changed.get("keep", len(log.t))
    q, tau = log.q[:k] * changed.get("q", 1.0), log.tau[:k].copy()
    dq = None if "dq" not in changed else changed["dq"] * np.gradient(log.q, log.t, axis=0)
    if "nan" in changed:
        tau[changed["nan"], 2] = np.nan
    options = {key: changed[key] for key in ("held_out", "cut_off") if key in changed}
    with pytest.raises(DefinitionError, match=words):
        identify(JointLog("a log", log.joints, log.t[:k], q, tau, dq), sx.arms.ur5e(), **options)


@pytest.mark.full
def test_log_of_20_s_identifies_rotors_friction_and_payload():
    pytest.importorskip("mujoco")
    changes = {
        "robot.plant.mass_factor": 1.0,
        "simulation.plant": "mujoco",
        "simulation.friction": "dry",
        "simulation.t1": 20.0,
    }
    log = sx.scenarios.load("panda-payload", changes).simulate(log_every=1, progress=False).log
    tau = np.asarray(log.tau)
    noise = 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * np.random.default_rng(0).normal(size=tau.shape)
    q = 1e-5 * np.round(np.asarray(log.state.q) / 1e-5)
    arm = sx.arms.panda()
    identified = identify(JointLog("a run", arm.joint_names, np.asarray(log.t), q, tau + noise), arm)
    np.testing.assert_allclose(identified.values("armature"), 0.1, rtol=0.05)
    np.testing.assert_allclose(identified.values("coulomb"), 0.3, rtol=0.05)
    assert identified.values("payload.mass")[0] == pytest.approx(2.0, rel=0.02)
    center = [identified.values(f"payload.center.{axis}")[0] for axis in "xyz"]
    np.testing.assert_allclose(center, [0.0, 0.0, 0.1], atol=5e-3)
    # A torque held for a period acts half a period after its time stamp on average.
    (fit,) = identified.logs
    assert fit.lag == pytest.approx(-0.45e-3, abs=5 * fit.lag_error + 5e-5)


@pytest.mark.parametrize(
    ("value", "standard_error", "text"),
    [
        (1.37912, 0.01684, ("1.379", "0.033")),
        (2.976e-12, 0.1, ("0.00", "0.20")),
        (-1e-4, 0.05, ("0.000", "0.098")),
        (3.761, 1.9, ("3.8", "3.7")),
        (0.99999, 0.0509, ("1.00", "0.10")),
        (412.3, 60.0, ("412", "120")),
        (1.23456e-9, 1e-11, ("1.235e-09", "2e-11")),
    ],
)
def test_a_value_is_shown_to_the_second_digit_of_its_interval(value, standard_error, text):
    parameter = EstimatedParameter("payload.mass", "", "", "kg", value, standard_error, 1.0)
    assert parameter.as_text() == text
