"""Rotor inertia and joint friction, learnt from torques and positions, alone and in arms with unknown rotors."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax import analysis, scenarios
from slidax.law import JointLearning
from slidax.law.adaptation import noise_of
from slidax.motions import Tabulated
from slidax.simulation import Run
from tests.law.moved import LINKS, PERIOD, motion, swept, taught

RATED = {"mass": LINKS, "torque": [100.0, 12.0], "deviation": 1e-5 / np.sqrt(12.0), "period": PERIOD}
TRUE = np.array([0.2, 0.06])


def learning(**changes):
    return JointLearning.of_arm(rotors=np.zeros(2), **{**RATED, **changes})


def rounded(q, resolution=1e-5):
    return resolution * np.round(q / resolution)


def test_rotors_and_coulomb_friction_are_learnt_from_an_exciting_motion():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, np.array([1.5, 0.3]))
    _, learnt = taught(learning(), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.1)
    np.testing.assert_allclose(learnt.coulomb[-1], [1.5, 0.3], rtol=0.15)


def test_a_wrong_rotor_inertia_is_corrected_within_a_tenth_of_a_second():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, 0.0)
    _, learnt = taught(learning(rotor=[1.0, 0.6]), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[100], TRUE, rtol=0.25)


def test_links_lighter_than_the_model_give_a_negative_rotor_inertia():
    torque = swept(1.0)
    q, dq = motion(torque, 0.0, 0.0, links=np.array([[0.35, 0.08], [0.08, 0.02]]))
    _, learnt = taught(learning(rotor_min=0.0, rotor=0.01), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1, 0], -0.15, rtol=0.2)


def test_unmodelled_weight_of_a_swinging_payload_does_not_bias_the_rotor_inertia():
    t = np.arange(4000) * PERIOD
    # The arm swings at 2 rad/s, and the unmodelled weight varies with it, like a negative inertia.
    q = np.stack([0.4 * np.sin(2.0 * t), 0.3 * np.sin(2.0 * t)], axis=1)
    dq = np.stack([0.8 * np.cos(2.0 * t), 0.6 * np.cos(2.0 * t)], axis=1)
    torque = (-4.0 * q) @ (LINKS + np.diag(TRUE)) + 20.0 * q
    _, learnt = taught(learning(rotor=TRUE), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.05)


def test_the_estimates_stay_unchanged_at_rest():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, 0.0)
    _, learnt = taught(learning(), rounded(q), dq, torque)
    still = np.zeros((5000, 2))
    noise = rounded(np.random.default_rng(3).normal(0.0, 3e-6, (5000, 2)))
    _, later = taught(learning(rotor=np.asarray(learnt.rotor[-1])), noise, still, still)
    # The first samples of noise look like a jump; after that not a bit changes.
    np.testing.assert_allclose(later.rotor[100], learnt.rotor[-1], rtol=1e-2)
    np.testing.assert_array_equal(later.rotor[-1], later.rotor[100])


def test_coarse_encoders_do_not_bias_the_inertia_to_zero():
    torque = swept(0.3)
    q, dq = motion(torque, TRUE, 0.0)
    coarse = 2.5e-4
    adaptation = learning(deviation=coarse / np.sqrt(12.0), rotor=TRUE)
    _, learnt = taught(adaptation, rounded(q, coarse), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.25)
    ungated = eqx.tree_at(
        lambda a: (a.gate, a.coherence, a.high), adaptation, (jnp.zeros(()), jnp.zeros(()), jnp.asarray(800.0))
    )
    _, drawn = taught(ungated, rounded(q, coarse), dq, torque)
    assert np.any(np.asarray(drawn.rotor[-1]) < 0.6 * TRUE)


def test_rotor_inertia_is_learnt_despite_lost_samples():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, 0.0)
    arrives = np.ones(len(q), bool)
    for start in range(100, 1900, 90):
        arrives[start : start + 15] = False
    missed = np.concatenate([[False], ~arrives[:-1]])[arrives]
    # A law would hold its last torque while samples are lost; here the sweep goes on, which is harder.
    _, learnt = taught(learning(), rounded(q)[arrives], dq[arrives], torque[arrives], missed)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.35)


def test_initial_rotor_inertia_is_the_models_or_0_002_times_the_rated_torque():
    np.testing.assert_allclose(learning().rotor, [0.2, 0.024])
    known = JointLearning.of_arm(rotors=[0.3, 0.0], **RATED)
    np.testing.assert_allclose(known.rotor, [0.3, 0.024])
    np.testing.assert_allclose(known.counted, [0.3, 0.0])
    # An arm whose model has no rotors starts at zero.
    np.testing.assert_allclose(JointLearning.of_arm(rotors=None, **RATED).rotor, 0.0)
    unknown = JointLearning.of_arm(rotors=np.zeros(2), **{**RATED, "torque": [np.inf, 12.0]})
    np.testing.assert_allclose(unknown.rotor, [0.002 * 25.0 * 0.5, 0.024])


@pytest.mark.parametrize("high", [80.0, 200.0])
def test_computed_noise_in_the_pass_band_agrees_with_a_simulation(high):
    deviation = 1e-4
    white = np.random.default_rng(5).normal(0.0, deviation, (40, 500, 2))
    adaptation = eqx.tree_at(lambda a: a.high, learning(), jnp.asarray(high))
    still = np.zeros((500, 2))
    ends = [np.asarray(taught(adaptation, noise, still, still)[0].stages)[-1, 1] for noise in white]
    np.testing.assert_allclose(np.std(ends), noise_of(deviation, 15.0, high, PERIOD), rtol=0.2)


def test_estimates_stay_bounded_for_any_measurements():
    generator = np.random.default_rng(7)
    adaptation = learning()
    wild = generator.choice([0.0, 1.0, -1e3, 1e150, -1e300, 1e308], (3000, 2))
    memory, learnt = taught(adaptation, wild, -wild, wild[::-1])
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((memory, learnt)))
    assert np.all(np.asarray(memory.information)[0] <= np.asarray(adaptation.window) * (1 + 1e-12))
    assert np.all(np.asarray(learnt.rotor) <= adaptation.rotor_max + np.diagonal(LINKS))


PANDA, UR5E = "panda-payload", "ur5e-payload"
NOMINAL, TRUE_ROTORS = (0.0, 0.03, 0.1, 0.2), (0.02, 0.05, 0.1, 0.3)
CORNERS = ((0.1, 0.1), (0.0, 0.1), (0.1, 0.03), (0.03, 0.3))
DAILY = [(PANDA, 0.0, 0.1), (PANDA, 0.03, 0.3), (UR5E, 0.1, 0.02)]
# Steady error of the exactly known arm at each true inertia; at 0.02, where that law fails, the requirement.
KNOWN = {
    PANDA: {0.02: 8e-4, 0.05: 3.5e-4, 0.1: 2.6e-4, 0.3: 1.6e-4},
    UR5E: {0.02: 1.5e-3, 0.05: 1.3e-3, 0.1: 8.2e-4, 0.3: 4.3e-4},
}
STEP = {PANDA: 0.5, UR5E: 0.7}
HARDER: list[tuple[str, dict[str, Any]]] = [
    *((name, {"sensor.delay": delay}) for name in (PANDA, UR5E) for delay in (2, 3)),
    *((name, {"sensor.resolution": step}) for name in (PANDA, UR5E) for step in (1e-4, 2.5e-4)),
    *((name, {"robot.plant.load.mass": mass}) for name in (PANDA, UR5E) for mass in (1.0, 4.0)),
    *((name, {}) for name in ("panda-table", "panda-pick", "panda-drop")),
]


def cells() -> list[Any]:
    every = [(name, nominal, true) for name in (PANDA, UR5E) for true in TRUE_ROTORS for nominal in NOMINAL]
    return [pytest.param(*cell, marks=[] if cell in DAILY else [pytest.mark.full]) for cell in every]


def simulated(name: str, nominal: float, true: float, **changes: Any) -> Run:
    rotors = {"robot.nominal.armature": nominal, "robot.plant.armature": true}
    return scenarios.load(name, {**rotors, **changes}).simulate(log_every=None, progress=False)


@pytest.mark.parametrize(("name", "nominal", "true"), cells())
def test_learning_law_is_nearly_as_accurate_as_the_known_arm_for_all_rotor_inertias(name, nominal, true):
    run = simulated(name, nominal, true)
    assert analysis.envelope_violations(run) == 0
    assert np.max(analysis.steady_error(run)) <= 1.2 * KNOWN[name][true]
    assert np.max(analysis.steady_torque_step(run)) < STEP[name]


@pytest.mark.full
@pytest.mark.parametrize(("name", "changes"), HARDER)
@pytest.mark.parametrize(("nominal", "true"), CORNERS)
def test_envelope_holds_with_delay_coarse_encoders_payloads_or_contact(name, changes, nominal, true):
    # docs/learning.md names this case as the remaining exception, at a reversal.
    left = 5 if (name, changes, nominal, true) == (UR5E, {"sensor.delay": 3}, 0.1, 0.03) else 0
    assert analysis.envelope_violations(simulated(name, nominal, true, **changes)) <= left


@pytest.mark.full
@pytest.mark.parametrize("name", [PANDA, UR5E])
@pytest.mark.parametrize("true", [0.005, 0.5, 1.0])
@pytest.mark.parametrize("nominal", NOMINAL)
def test_envelope_holds_with_very_small_or_large_rotor_inertias(name, true, nominal):
    # docs/learning.md explains why this case leaves the envelope, and which setting keeps it inside.
    beyond = (name, true, nominal) == (UR5E, 0.005, 0.2)
    changes = {"scheme.sampled_data.gate.speed": 25.0} if beyond else {}
    assert analysis.envelope_violations(simulated(name, nominal, true, **changes)) == 0
    if beyond:
        assert simulated(name, nominal, true).outcome.kind == "left_envelope"


def test_an_arm_without_rotor_inertia_in_its_model_leaves_its_envelope_without_learning():
    run = simulated(PANDA, 0.0, 0.1, **{"scheme.sampled_data.adaptation": None})
    assert analysis.envelope_violations(run) > 1000


def test_learnt_inertia_can_be_kept_and_used_without_learning():
    changes = {"robot.nominal.armature": 0.0, "robot.plant.armature": 0.1}
    learns = scenarios.load(PANDA, changes).simulate(log_every=1, progress=False)
    last = {name: [float(x) for x in learns.log.signals[name][-1]] for name in ("rotor", "coulomb")}
    frozen = {**changes, "scheme.sampled_data.adaptation": {"kind": "known_joints", **last}}
    run = scenarios.load(PANDA, frozen).simulate(log_every=1, progress=False)
    assert analysis.envelope_violations(run) == 0
    assert np.max(analysis.steady_error(run)) <= 1.5 * np.max(analysis.steady_error(learns))
    np.testing.assert_array_equal(run.log.signals["rotor"][0], run.log.signals["rotor"][-1])


HOME, AWAY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.4, -0.4, 0.3, -2.0, 0.4, 1.9, 1.2]
HOURS = {
    "hold": ([0.0, 2.0, 4.0], [HOME, AWAY, HOME]),
    "creep": ([0.0, 2.0, 4.0, 3600.0], [HOME, AWAY, HOME, AWAY]),
    "starts": (
        [20.0 * k + later for k in range(180) for later in (0.0, 2.0)],
        [there for k in range(180) for there in ((HOME, AWAY) if k % 2 == 0 else (AWAY, HOME))],
    ),
}
"""Times and postures of rest: a hold after a motion, a creep at about 1e-4 rad/s after it, and a motion every 20 s."""


@pytest.mark.full
@pytest.mark.parametrize("hour", HOURS)
def test_estimates_do_not_drift_in_an_hour_of_hold_creep_and_repeated_starts(hour):
    times, places = HOURS[hour]
    rest = np.zeros_like(places)
    scenario = scenarios.load(
        PANDA, {"robot.nominal.armature": 0.0, "robot.plant.armature": 0.1, "simulation.log_every": 1000}
    )
    motion = Tabulated.through(times, places, velocities=rest, accelerations=rest)
    run = scenario.replace(trajectory=motion, state0=sx.State(HOME), t1=3600.0).simulate(progress=False)
    assert analysis.envelope_violations(run) == 0
    learnt = np.asarray(run.log.signals["rotor"])
    # Occasional motions still teach a little; nothing else changes the learnt inertia.
    since, share = (60, 0.1) if hour == "starts" else (10, 1e-3)
    np.testing.assert_allclose(learnt[-1], learnt[since], rtol=share)
