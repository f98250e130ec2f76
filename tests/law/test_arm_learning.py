"""The learning of the whole arm: its payload, links, rotors and friction, and what the joints take over from it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.integrators import value_rate_curvature
from slidax.core.types import State
from slidax.law import ComputedTorque, Kalman, KnownArm, StrongTracking, sampled_data
from slidax.law.adaptation import Experience
from slidax.law.arm_model import ArmParameters, coupled_inertia
from slidax.law.least_squares import NOISE
from slidax.law.model_trust import UNSURE, lost_payload
from slidax.scenarios import load
from tests.law.moved import ARM, PERIOD, after_sample, learner, taught
from tests.paper_examples import TWO_LINK

NO = jnp.asarray(False)
ARM_LEARNING = {"scheme.sampled_data.adaptation": {"kind": "arm_learning"}}


def test_an_equation_with_less_weight_has_a_larger_variance():
    adaptation, still = learner(), jnp.zeros(2)
    memory = adaptation.init(State(q=still, dq=still))
    args = still, still, still, ARM.mass(still), ARM.bias(still, still), jnp.asarray(PERIOD), NO, ARM
    where = lambda m: (m.equations.drives, m.equations.y, m.equations.weights)  # noqa: E731
    speeds = memory.equations.drives.at[0].set(jnp.ones(2))
    memory = eqx.tree_at(where, memory, (speeds, jnp.ones(2), jnp.array([0.25, 0.0])))
    after = after_sample(
        adaptation, Experience(*args), eqx.tree_at(lambda m: m.trust.usual, memory, jnp.array([0.3, 0.2]))
    )
    viscous = adaptation.parameters(after.estimates.parameters).viscous
    np.testing.assert_allclose(viscous, [0.16 / (0.16 + UNSURE * 0.3 / 0.25), 0.0], rtol=1e-12)


def test_a_model_in_use_gives_the_arm_its_payload_and_links():
    adaptation = learner()
    memory = adaptation.init(State(q=jnp.zeros(2), dq=jnp.zeros(2)))
    used = ArmParameters(
        payload=jnp.array([1.0, *[0.0] * 9]),
        factors=jnp.array([0.1, -0.1]),
        viscous=jnp.array([0.3, 0.2]),
        first=jnp.array([0.5, 0.1]),
        second=jnp.zeros(2),
        rotor=jnp.array([0.05, 0.02]),
    )
    half = eqx.tree_at(lambda m: (m.estimates.used, m.trust.share), memory, (used.vector(), jnp.asarray(0.5)))
    q, dq = jnp.array([0.3, -0.5]), jnp.array([1.0, -0.4])
    known = adaptation.frozen(half)
    assert isinstance(known, KnownArm)
    for robot in (adaptation.robot(ARM, half), known.robot(ARM, jnp.zeros(2))):
        none = adaptation.robot(ARM, memory)
        full = adaptation.robot(ARM, eqx.tree_at(lambda m: m.trust.share, half, jnp.asarray(1.0)))
        np.testing.assert_allclose(robot.bias(q, dq), 0.5 * (none.bias(q, dq) + full.bias(q, dq)), atol=1e-12)
        np.testing.assert_allclose(robot.mass(q), 0.5 * (none.mass(q) + full.mass(q)), atol=1e-12)
    # The masses of both links, and of the body that was added at the elbow.
    weight = 9.81 * (1.0 * 0.5 + 0.1 * 2.0 * 0.25 - 0.1 * 0.5 * (0.5 + 0.2))
    rest = full.bias(0 * q, 0 * q) - ARM.bias(0 * q, 0 * q)
    np.testing.assert_allclose(jnp.abs(rest[0]), weight, rtol=1e-12)


@pytest.mark.parametrize("rotor", [0.05, 0.0])
def test_joints_take_over_inertias_and_friction_of_the_arms_model_once_it_is_fully_used(rotor):
    adaptation, still = learner(), jnp.zeros(2)
    memory, links = adaptation.init(State(q=still, dq=still)), np.asarray(ARM.mass(still))
    # A payload with a moment and an inertia, which may have taken the rotors' share.
    used = jnp.zeros(20).at[jnp.array([0, 2, 6])].set(jnp.array([1.0, 0.2, 0.3]))
    used = used.at[14:18].set(jnp.array([0.3, 0.2, 0.1, 9.0])).at[18:].set(rotor)
    args = still, still, still, ARM.mass(still), ARM.bias(still, still), jnp.asarray(PERIOD), NO, ARM
    for share, loud in ((1.0, 0.0), (0.9, 0.0), (1.0, 0.01)):
        where = lambda m: (m.estimates.used, m.trust.share, m.trust.loud)  # noqa: E731
        known = eqx.tree_at(where, memory, (used, jnp.asarray(1.0), jnp.asarray(loud)))
        mass = adaptation.robot(ARM, known).mass(still)
        known = eqx.tree_at(
            lambda m: (m.filter_inertia, m.trust.share),
            known,
            (coupled_inertia(mass, jnp.asarray(1.0)), jnp.asarray(share)),
        )
        after = after_sample(adaptation, Experience(*args), known)
        whole = share == 1.0 and loud == 0.0
        expected = np.maximum(rotor, 1.0 / np.linalg.norm(np.linalg.inv(mass), axis=1) - np.diagonal(links))
        np.testing.assert_allclose(after.joints.rotor, expected if whole else 0.1, rtol=1e-12)
        np.testing.assert_allclose(after.joints.coulomb, [0.4, 3.0] if whole else [0.0, 0.0], atol=1e-12)
        if whole:
            given_up = eqx.tree_at(lambda m: m.trust.share, after, jnp.zeros(()))
            strength = eigenvalues(mass, adaptation.robot(ARM, given_up).mass(still))
            assert strength.min() > 0.25 and strength.max() < 1.1
            # Rotors alone would be too weak, and the payload's inertia without its couplings too strong.
            assert eigenvalues(mass, links + rotor * np.eye(2)).min() < 0.2
            assert eigenvalues(mass, links + np.diag(np.diagonal(mass - links))).max() > 3.0


def eigenvalues(mass, believed):
    """Eigenvalues of M⁻¹ M̂: the feedback's strength relative to that with the right mass."""
    return np.linalg.eigvals(np.linalg.solve(mass, believed)).real


def test_a_heavy_joint_gets_its_own_noise_unless_a_scenario_states_one():
    def noise(**changes):
        return load("ur5e-payload", {**ARM_LEARNING, **changes}).controller.adaptation.noise

    own = noise()
    assert own[1] > 2.0 * NOISE and own[-1] == NOISE
    coarse = noise(**{"sensor.resolution": 1e-4})
    assert coarse[1] > 3.0 * own[1]
    stated = f"{next(iter(ARM_LEARNING))}.noise"
    np.testing.assert_array_equal(noise(**{stated: 0.3}), 0.3)
    np.testing.assert_array_equal(noise(**{stated: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]})[3], 0.4)
    with pytest.raises(DefinitionError, match=r"noise: must be one number or one for each of the 6 joints; got 2"):
        noise(**{stated: [0.1, 0.2]})


def test_a_lost_payload_is_recognised_by_its_missing_torque():
    noise, carried = learner().noise ** 2, jnp.array([4.0, -1.0])
    heard = jnp.ones(2, bool)
    for share, least in ((1.0, 1.0), (0.6, 0.6), (1.5, 1.0)):
        fits, lost, left = lost_payload(-share * carried + 0.1, carried, heard, noise)
        assert fits == (share <= 1.2)
        np.testing.assert_allclose(lost, least, atol=0.05)
        np.testing.assert_allclose(left, (lost - share) * carried + 0.1, atol=1e-12)
    # More payload, and pushes in other directions.
    for missed in (carried, jnp.array([1.0, 4.0]), jnp.array([0.0, 1.0])):
        assert not lost_payload(missed, carried, heard, noise)[0]
    assert not lost_payload(-carried, carried, jnp.zeros(2, bool), noise)[0]


def test_the_estimators_bandwidth_of_a_learnt_arm_takes_the_couplings_between_joints_into_account():
    adaptation, q, still = learner(), jnp.array([0.3, -0.5]), jnp.zeros(2)
    memory = adaptation.init(State(q=q, dq=still))
    args = q, still, still, ARM.mass(q), ARM.bias(q, still), jnp.asarray(PERIOD), NO, ARM
    for share in (0.0, 0.5, 1.0):
        before = eqx.tree_at(lambda m: (m.trust.share, m.slot), memory, (jnp.asarray(share), jnp.asarray(9.0)))
        after = after_sample(adaptation, Experience(*args), before)
        mass = np.asarray(adaptation.robot(ARM, before).mass(q))
        coupled = 1.0 / np.linalg.norm(np.linalg.inv(mass), axis=1)
        expected = np.diagonal(mass) ** (1.0 - share) * coupled**share
        assert share == 0.0 or (expected < 0.9 * np.diagonal(mass)).any()
        # Without the arm's model the inertia is that of this posture, not of the last window.
        for at in (q, q + 1.0):
            now = adaptation.robot(ARM, after)
            wanted = expected if share > 0.0 else np.diagonal(now.mass(at))
            np.testing.assert_allclose(adaptation.filter_inertia(now, at, after), wanted, rtol=1e-12)


def slow_and_fast(t):
    """Positions of two joints that move slowly and fast, with many reversals [n]."""
    first = 0.6 * jnp.sin(1.3 * t) + 0.1 * jnp.sin(9.0 * t) + 0.02 * jnp.sin(23.0 * t)
    second = 0.5 * jnp.sin(1.7 * t + 1.0) + 0.12 * jnp.sin(8.0 * t) + 0.02 * jnp.sin(29.0 * t)
    return jnp.stack([first, second])


@pytest.mark.full
def test_stribeck_friction_and_ripple_are_learnt_from_a_motion_with_reversals():
    times = PERIOD * np.arange(12000)
    excess, cosine, sine = jnp.array([0.3, 0.1]), jnp.array([0.2, -0.1]), jnp.array([-0.1, 0.15])

    def state(t):
        q, dq, ddq = value_rate_curvature(slow_and_fast, t)
        return q, dq, ddq

    def needed(t):
        q, dq, ddq = state(t)
        shapes = 0.4 * jnp.tanh(dq / 0.01) + excess * jnp.exp(-((dq / 0.1) ** 2)) * jnp.tanh(dq / 0.01)
        waves = cosine * jnp.cos(20.0 * q) + sine * jnp.sin(20.0 * q)
        return ARM.mass(q) @ ddq + ARM.bias(q, dq) + 0.2 * dq + shapes + waves

    q, dq, _ = jax.jit(jax.vmap(state))(times)
    torque = jax.jit(jax.vmap(needed))(times + 0.5 * PERIOD)
    adaptation = learner(stribeck=0.1, ripple=20.0)
    memory, _ = taught(adaptation, *(np.asarray(x) for x in (q, dq, torque)))
    arm = adaptation.parameters(memory.estimates.parameters)
    assert arm.more.shape == (3, 2)
    for learnt, true in zip(arm.more, (excess, cosine, sine), strict=True):
        np.testing.assert_allclose(learnt, true, atol=0.03)
    np.testing.assert_allclose(arm.coulomb, 0.4, atol=0.05)
    assert memory.trust.share == 1.0


def test_a_model_with_stribeck_friction_and_ripple_compensates_both():
    adaptation, at, still = learner(stribeck=0.1, ripple=[20.0, 12.0]), jnp.array([0.3, -0.2]), jnp.zeros(2)
    memory = adaptation.init(State(q=at, dq=still))
    assert memory.sums.shape == (4, 9, 2) and memory.estimates.used.shape == (10 + 8 * 2,)
    assert learner().init(State(q=at, dq=still)).sums.shape == (4, 6, 2)
    excess, cosine, sine = jnp.array([[0.3, 0.1], [0.2, -0.1], [-0.1, 0.15]])
    nothing = eqx.tree_at(lambda m: m.trust.share, memory, jnp.asarray(1.0))
    used = nothing.estimates.used.at[-8:-2].set(jnp.concatenate([excess, cosine, sine]))
    known = eqx.tree_at(lambda m: m.estimates.used, nothing, used)
    phase = jnp.array([20.0, 12.0]) * at
    ripple = cosine * jnp.cos(phase) + sine * jnp.sin(phase)
    with_ripple, without = (adaptation.robot(ARM, each) for each in (known, nothing))
    np.testing.assert_allclose(with_ripple.bias(at, still) - without.bias(at, still), ripple, atol=1e-12)
    slopes = [jax.grad(robot.potential)(at) for robot in (with_ripple, without)]
    np.testing.assert_allclose(slopes[0] - slopes[1], ripple, atol=1e-12)
    np.testing.assert_array_equal(with_ripple.mass(at), without.mass(at))
    slow = jnp.array([0.05, -0.1])
    more = adaptation.friction(known, slow) - adaptation.friction(nothing, slow)
    np.testing.assert_allclose(more, excess * jnp.exp(-((slow / 0.1) ** 2)) * jnp.tanh(slow / 0.01), atol=1e-12)
    signals = adaptation.signals(known)
    np.testing.assert_array_equal(signals["static_excess"], excess)
    np.testing.assert_array_equal(signals["ripple_sine"], sine)
    assert not {"static_excess", "ripple_cosine"} & set(learner().signals(learner().init(State(q=at, dq=still))))


def test_an_arm_that_is_not_described_by_its_links_is_refused():
    law = sampled_data(ComputedTorque(TWO_LINK, 100.0, 20.0), period=1e-3, adaptation=learner())
    state = State(q=jnp.zeros(2), dq=jnp.zeros(2))
    reference = load("example-4.1").trajectory.reference(jnp.zeros(()))
    with pytest.raises(DefinitionError, match="use `joint_learning`"):
        law(jnp.zeros(()), state, reference, reference, law.init(jnp.zeros(()), state, reference))


def test_the_filter_of_a_learnt_arm_grows_faster_unless_the_scenario_forbids_it():
    estimator = "scheme.sampled_data.estimator"
    twice = {f"{estimator}.growth": 2.0}
    grows = load("panda-payload", {**ARM_LEARNING, **twice}).controller.estimator
    assert isinstance(grows, StrongTracking) and grows.growth == 2.0
    np.testing.assert_allclose(grows.deviation, 1e-5 / np.sqrt(12.0))
    assert load("panda-payload", ARM_LEARNING).controller.estimator.growth == 1.5
    for changes in ({}, {**ARM_LEARNING, f"{estimator}.growth": 1.0}):
        assert isinstance(load("panda-payload", changes).controller.estimator, Kalman)
    with pytest.raises(DefinitionError, match="`acceleration_density` and `growth` both set the gains"):
        load("panda-payload", {estimator: {"kind": "kalman", "acceleration_density": 1.0, "growth": 2.0}})


def test_two_compensations_of_viscous_friction_are_refused():
    with pytest.raises(DefinitionError, match="both compensate viscous friction"):
        sampled_data(ComputedTorque(ARM, 100.0, 20.0), period=1e-3, adaptation=learner(), viscous_feedforward=True)


def test_a_scenario_sets_the_samples_of_a_window_and_the_payload_of_a_known_arm():
    # 10 ms at the sample time of 2 ms.
    assert load("ur5e-payload", ARM_LEARNING).controller.adaptation.samples == 5
    body = [1.0, *[0.0] * 9]
    known = load("panda-payload", {"scheme.sampled_data.adaptation": {"kind": "known_arm", "payload": body}})
    np.testing.assert_array_equal(known.controller.adaptation.payload, body)


@pytest.mark.full
@pytest.mark.parametrize(("name", "most"), [("panda-payload", 2e-5), ("ur5e-payload", 1e-4)])
def test_the_steady_error_is_less_than_a_third_of_that_with_joint_learning(name, most):
    learnt = np.asarray(load(name, ARM_LEARNING).simulate(log_every=1).log.e)
    of_joints = np.asarray(load(name).simulate(log_every=1).log.e)
    half = len(learnt) // 2
    error, before = np.abs(learnt[half:]).max(), np.abs(of_joints[half:]).max()
    assert error < most and error < before / 3.0


PUSHED = {
    "disturbance.terms": [
        {"kind": "step", "value": [2.6, 2.6, -2.6, 2.6, 0.36, 0.36, -0.36], "start": 4.0, "end": 4.1},
        {"kind": "step", "value": [26.0, -26.0, 26.0, 26.0, 3.6, 3.6, -3.6], "start": 5.0, "end": 5.1},
    ]
}


@pytest.mark.full
def test_the_arms_model_comes_into_use_with_a_law_whose_error_is_large():
    run = load("panda-payload", {**ARM_LEARNING, "scheme.name": "computed_torque", "simulation.t1": 4.0}).simulate()
    assert np.asarray(run.log.signals["arm_share"])[-1] == 1.0


@pytest.mark.full
def test_the_first_model_is_not_given_up_while_the_error_falls():
    run = load("panda-payload", {**ARM_LEARNING, "scheme.name": "slotine_li", "simulation.t1": 6.0}).simulate(
        log_every=1
    )
    error, share = np.abs(np.asarray(run.log.e)).max(axis=1), np.asarray(run.log.signals["arm_share"])
    assert error[4000:].max() < 1e-4 and share[3000:].min() == 1.0


@pytest.mark.full
def test_the_error_after_pushes_is_soon_as_small_as_before():
    run = load("panda-payload", {**ARM_LEARNING, **PUSHED}).simulate(log_every=1)
    error = np.abs(np.asarray(run.log.e)).max(axis=1)
    assert error[3000:4000].max() < 2e-5 and error[-1000:].max() < 2e-5
    assert np.asarray(run.log.signals["arm_share"])[-1] == 1.0


@pytest.mark.full
@pytest.mark.parametrize("horizon", [5e-3, 6e-3, 7e-3])
def test_a_push_that_lasts_long_enough_to_be_learnt_is_forgotten_at_any_horizon(horizon):
    push = {"kind": "step", "value": [-2.6, -2.6, -2.6, -2.6, -0.36, 0.36, -0.36], "start": 5.0, "end": 6.0}
    changes = {"scheme.sampled_data.horizon": horizon, "disturbance.terms": [push], "simulation.t1": 7.5}
    run = load("panda-payload", {**ARM_LEARNING, **changes}).simulate(log_every=1)
    error, share = np.abs(np.asarray(run.log.e)).max(axis=1), np.asarray(run.log.signals["arm_share"])
    assert share[5100:6000].min() == 0.0 and share[-1] == 1.0
    # The model that was learnt during the push is in use at its end: errors are up to twice those of joint_learning.
    assert error[6060:6500].max() < 3e-4 and error[6500:].max() < 3e-5


@pytest.mark.full
def test_a_payload_that_is_let_go_is_learnt_anew():
    run = load("panda-payload", {**ARM_LEARNING, "robot.plant.load.released": 3.0}).simulate(log_every=1)
    share = np.asarray(run.log.signals["arm_share"])
    error = np.abs(np.asarray(run.log.e)).max(axis=1)
    mass = np.asarray(run.log.signals["payload_mass"])
    # The loss is recognised: the model stays in use, without the payload.
    assert share[2999:].min() == 1.0 and abs(mass[-1]) < 0.1 * mass[2999]
    assert error[-500:].max() < 5e-5 and run.outcome.kind == "ok"
