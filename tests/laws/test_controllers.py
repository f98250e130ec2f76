"""Every scheme is a pure function of arrays that compiles once, batches and differentiates.

All tests share two compilations per member: `compiled` at one point, and `sloped` with gradients over a batch.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State
from slidax.law import GravityCompensatedPD, JointPID, Kalman, PrescribedPerformance
from tests.enrolled import assert_finite, assert_float_leaves, assert_same, every, stacked
from tests.law.members import CONTROLLERS, CONTROLLERS_LIKE_OTHERS


class Point(NamedTuple):
    """Inputs of a scheme: the start and its reference, and the time, state and references of a sample."""

    start: State
    first: Reference
    t: jax.Array
    state: State
    now: Reference
    ahead: Reference


def at(case, t, state):
    """The inputs at time t, after the start of the case."""
    first, now, ahead = (case.trajectory.reference(jnp.asarray(time)) for time in (0.0, t, t + 1e-3))
    return Point(case.start, first, jnp.asarray(t), state, now, ahead)


def near(case, t, seed=0):
    """A state close to the reference at time t, inside any envelope of the members."""
    n = case.robot.joints
    rng = np.random.default_rng(seed)
    reference = case.trajectory.reference(jnp.asarray(t))
    e, de = rng.uniform(-1e-3, 1e-3, n) * 0.3, rng.normal(size=n) * 0.1
    return State(q=reference.q + e, dq=reference.dq + de)


def on_reference(case, t):
    reference = case.trajectory.reference(jnp.asarray(t))
    return State(q=reference.q, dq=reference.dq)


def answer(controller, point):
    memory = controller.init(jnp.zeros(()), point.start, point.first)
    return controller(point.t, point.state, point.now, point.ahead, memory)


TRACES = []


@eqx.filter_jit
def compiled(controller, point):
    TRACES.append(None)
    return answer(controller, point)


def weighted(tau):
    """A weighted sum, in which equal and opposite torques do not cancel."""
    return jnp.sum(tau * jnp.arange(1.0, tau.shape[0] + 1.0))


@eqx.filter_jit
@jax.vmap
def torques_and_slopes(controller, point):
    def total(both):
        tau = answer(both[0], point._replace(state=both[1])).tau
        return weighted(tau), tau

    (_, tau), (by_gains, by_state) = jax.value_and_grad(total, has_aux=True)((controller, point.state))
    return tau, by_gains, by_state


FACTORS = (1.0, 1.01, 1.05)
"""Factors of all gains at the first points of the batch; the other points have the unscaled gains."""
TIMES = (0.5, 5.0, 8.0)


def scaled(controller, factor):
    return jax.tree.map(lambda leaf: leaf * factor, controller)


@pytest.fixture(scope="module")
def sloped(case):
    """Torques and their gradients: near the motion with scaled gains, near and on the motion, and at the start."""
    points = [at(case, 1.0, near(case, 1.0))] * len(FACTORS)
    points += [at(case, t, state(case, t)) for t in TIMES for state in (near, on_reference)]
    # Within 100 periods of the start, after which a gate restarts the law.
    points += [at(case, 0.05, State(q=case.start.q, dq=case.start.dq + 0.1))]
    factors = [*FACTORS, *[1.0] * (len(points) - len(FACTORS))]
    return torques_and_slopes(stacked([scaled(case.controller, factor) for factor in factors]), stacked(points))


EVERY = every("case", CONTROLLERS, full=CONTROLLERS_LIKE_OTHERS, scope="module")
# These take long uncompiled or with gradients; simpler members cover both in the daily run.
SLOW = ("sampled_cftsmppc_4_1_layer_delay_and_recovery", "nftsmc_4_2", "sfsmc_4_2")
SLOPED = every("case", CONTROLLERS, full=(*CONTROLLERS_LIKE_OTHERS, *SLOW), scope="module")


@SLOPED
def test_compiled_and_eager_commands_agree(case):
    point = at(case, 1.0, near(case, 1.0))
    assert_same(answer(case.controller, point), compiled(case.controller, point), rtol=1e-9, atol=1e-12)


@SLOPED
def test_a_batch_over_any_gain_equals_a_loop(case, sloped):
    point = at(case, 1.0, near(case, 1.0))
    looped = [compiled(scaled(case.controller, factor), point).tau for factor in FACTORS]
    np.testing.assert_allclose(sloped[0][: len(FACTORS)], looped, rtol=1e-9)
    assert np.all(np.ptp(looped, axis=0) > 0)


@EVERY
def test_a_single_compilation_serves_many_gains_states_and_times(case):
    before = len(TRACES)
    for i, factor in enumerate((1.0, 1.01, 1.02, 1.03)):
        compiled(scaled(case.controller, factor), at(case, 0.5 * i, near(case, 0.5 * i, seed=i)))
    # No compilation at all after a member that differs only in its numbers.
    assert len(TRACES) - before <= 1


@EVERY
def test_every_gain_is_a_floating_array_leaf(case):
    assert_float_leaves(case.controller)


@SLOPED
def test_gradients_by_all_gains_and_by_the_state_are_finite_also_without_any_error(case, sloped):
    assert_finite(sloped)


@SLOPED
def test_nearly_every_gain_changes_the_first_torque(case, sloped):
    """At the start, the torque depends on all gains but at most `case.idle` of them."""
    reference = case.trajectory.reference(jnp.zeros(()))
    assert float(jnp.abs(case.start.q - reference.q).max()) > 0
    moved = [np.any(np.asarray(leaf[-1]) != 0) for leaf in jax.tree.leaves(sloped[1])]
    # The width of the core has an effect only inside the core.
    assert moved.count(False) <= case.idle


@SLOPED
def test_the_gradient_by_each_gain_matches_differences(case, sloped):
    point = at(case, 1.0, near(case, 1.0))
    flat, treedef = jax.tree.flatten(case.controller)

    def total(flat):
        return weighted(compiled(jax.tree.unflatten(treedef, flat), point).tau)

    for i, (leaf, slope) in enumerate(zip(flat, jax.tree.leaves(sloped[1]), strict=True)):
        h = 1e-6 * float(jnp.max(jnp.abs(leaf)) + 1e-2)
        up, down = ([*flat[:i], leaf + d, *flat[i + 1 :]] for d in (h, -h))
        if float(jnp.min(leaf)) == 0.0:  # a layer of zero cannot be less
            continue
        difference = (total(up) - total(down)) / (2 * h)
        np.testing.assert_allclose(jnp.sum(slope[0]), difference, rtol=2e-4, atol=1e-4)


@EVERY
def test_memory_and_its_rate_keep_tree_structure_shapes_and_types(case):
    point = at(case, 0.5, near(case, 0.5))
    before = case.controller.init(jnp.zeros(()), point.start, point.first)
    command = compiled(case.controller, point)
    for after in (command.memory, before if command.rate is None else command.rate):
        assert jax.tree.structure(before) == jax.tree.structure(after)
        for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
            assert (a.shape, a.dtype, a.weak_type) == (b.shape, b.dtype, b.weak_type)


@EVERY
def test_the_scheme_commands_one_torque_per_joint_of_its_arm(case):
    assert case.controller.joints == case.robot.joints
    tau = compiled(case.controller, at(case, 0.5, near(case, 0.5))).tau
    assert tau.shape == (case.robot.joints,) and np.all(np.isfinite(tau))


def has_an_envelope(case):
    law = getattr(case.controller, "step", case.controller)
    return isinstance(getattr(law, "transformation", None), PrescribedPerformance)


@EVERY
def test_a_scheme_has_an_envelope_around_its_start_exactly_with_prescribed_performance(case):
    reference = case.trajectory.reference(jnp.zeros(()))
    memory = case.controller.init(jnp.zeros(()), case.start, reference)
    envelope = case.controller.envelope(jnp.zeros(()), memory)
    if not has_an_envelope(case):
        assert envelope is None
        return
    e = np.asarray(case.start.q - reference.q)
    assert np.all(np.asarray(envelope.lower) < e) and np.all(e < np.asarray(envelope.upper))


@EVERY
def test_the_same_measurements_give_bitwise_equal_torques(case):
    point = at(case, 0.7, near(case, 0.7))
    first, second = (compiled(case.controller, point).tau for _ in range(2))
    np.testing.assert_array_equal(first, second)


# A prediction over a delay depends on the torques under way, and a filtered velocity on earlier samples.
IMMEDIATE = [
    (name, case)
    for name, case in CONTROLLERS
    if getattr(case.controller, "delay", 0) == 0 and not isinstance(getattr(case.controller, "estimator", None), Kalman)
]


@eqx.filter_jit
def feed_forward(nominal, state, ddq):
    """Torques of the motion without gravity, and of gravity."""
    return nominal.mass(state.q) @ ddq + nominal.coriolis(state.q, state.dq) @ state.dq, nominal.gravity(state.q)


@every("case", IMMEDIATE, full=CONTROLLERS_LIKE_OTHERS[1:], scope="module")
def test_torque_without_an_error_is_the_feedforward_of_the_nominal_arm(case):
    """At e = ė = 0 every law is `M0 q̈_d + C0 q̇ + G0`; a PD has only G0, a PID only its share of G0."""
    for t in (0.5, 1.5, 8.0):
        point = at(case, t, on_reference(case, t))
        reference = point.now
        motion, gravity = feed_forward(case.controller.nominal, point.state, reference.ddq)
        if isinstance(case.controller, GravityCompensatedPD | JointPID):
            motion = 0.0
        if isinstance(case.controller, JointPID):
            gravity = case.controller.gravity * gravity
        # A law that plans over a period takes the mean acceleration, so the acceleration is constant here.
        ahead = Reference(reference.q + 1e-3 * reference.dq, reference.dq + 1e-3 * reference.ddq, reference.ddq)
        command = compiled(case.controller, point._replace(start=on_reference(case, 0.0), ahead=ahead))
        np.testing.assert_allclose(command.tau, motion + gravity, rtol=1e-10, atol=1e-11)
