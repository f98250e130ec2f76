"""A run inside `vmap`, `jit` and `grad` is the same run."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.plant import DifferencedEncoders, Encoders
from slidax.simulation import Plant, simulate
from tests.paper_examples import MOTION_4_1, START_4_1, TWO_LINK, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Spring

GAINS = jnp.array([0.4, 0.6, 0.8])


def at_1_khz(k2, log_every=None, t1=5.0):
    law = eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2)
    return simulate(plant_4_1(), law, MOTION_4_1, START_4_1, t1=t1, period=1e-3, log_every=log_every)


def run(layer, shift):
    law = eqx.tree_at(lambda c: c.reaching.layer, law_4_1(), layer)
    start = State(q=START_4_1.q + shift, dq=START_4_1.dq)
    return simulate(plant_4_1(), law, MOTION_4_1, start, t1=1.0, period=1e-3, log_every=10)


def test_a_batch_of_runs_is_the_single_runs():
    """Invariants, not trajectories: to 1e-9 of their size; counts and faults exactly."""
    layers, shifts = jnp.array([0.1, 0.3]), jnp.array([0.0, 0.02])
    many = jax.jit(jax.vmap(run))(layers, shifts)
    for i, (layer, shift) in enumerate(zip(layers, shifts, strict=True)):
        single = run(layer, shift)
        one = jax.tree.map(lambda x, i=i: x[i], many)
        for a, b in zip(jax.tree.leaves(one.tally), jax.tree.leaves(single.tally), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9)
        assert int(one.fault.kind) == int(single.fault.kind)
        np.testing.assert_allclose(one.log.tau, single.log.tau, rtol=1e-6, atol=1e-6)
        assert int(np.sum(one.log.valid)) == len(single.log.t) == 101


def test_a_batch_tells_which_runs_went_wrong_where_and_when():
    @jax.jit
    @jax.vmap
    def many(radius):
        law = BoundedLaw(Spring(jnp.zeros(2), jnp.zeros(2)), radius)
        start = State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([1.0, 0.0]))
        return simulate(SMOOTH_PLANT, law, ConstantPosture([np.pi / 2, 0.0]), start, t1=0.4, period=0.04)

    done = many(jnp.array([0.095, 10.0, 0.135]))
    assert done.fault.kind.tolist() == [1, 0, 1]
    assert done.fault.joint.tolist() == [0, 0, 0]
    assert done.fault.absent.tolist() == [False, True, False]
    np.testing.assert_allclose(done.fault.t[::2], [0.12, 0.16], atol=1e-12)
    np.testing.assert_allclose(done.fault.bound[::2], [0.095, 0.135])
    assert np.sum(done.log.valid, axis=1).tolist() == [3, 11, 4]
    assert done.tally.samples.tolist() == [3, 11, 4]
    assert done.tally.violations.tolist() == [1, 0, 1]
    leaves = jax.tree.leaves((done.log, done.state, done.tally.torque_square, done.tally.late_error))
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)


def test_a_run_inside_jit_is_the_run_outside():
    inside = jax.jit(lambda k2: at_1_khz(k2, t1=1.0).tally)(jnp.asarray(0.6))
    outside = at_1_khz(jnp.asarray(0.6), t1=1.0).tally
    for a, b in zip(jax.tree.leaves(inside), jax.tree.leaves(outside), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)


@pytest.mark.parametrize(
    ("sensor", "law", "gain", "step"),
    [
        (Encoders(1e-4), SPRING, lambda law: law.stiffness, 1e-2),
        pytest.param(DifferencedEncoders(1e-5), SPRING, lambda law: law.stiffness, 1e-2, marks=pytest.mark.full),
        pytest.param(Encoders(1e-4), law_4_1(), lambda law: law.surface.k1, 1e-4, marks=pytest.mark.full),
    ],
    ids=["encoders", "differenced", "encoders and the paper's law"],
)
def test_the_gradient_through_encoders_is_that_of_the_loop_without_their_rounding(sensor, law, gain, step):
    """Without the straight-through derivative it is off by 7 %, by a third, and by 1.5 %."""

    def squared_error(change, sensor):
        changed = eqx.tree_at(gain, law, gain(law) + change)
        plant = Plant(TWO_LINK, SMOOTH_PLANT.disturbance, sensor)
        log = simulate(plant, changed, MOTION_4_1, START_4_1, t1=0.2, period=1e-3).log
        return jnp.sum(jnp.square(log.state.q - log.reference.q))

    found = jax.jit(jax.grad(lambda change: squared_error(change, sensor)))(jnp.zeros(()))
    exact = eqx.tree_at(lambda s: s.resolution, sensor, jnp.zeros(()))
    up, down = jax.jit(jax.vmap(lambda change: squared_error(change, exact)))(jnp.array([step, -step]))
    assert float(found) == pytest.approx(float(up - down) / (2 * step), rel=1e-4)


def final_error_and_effort(law, mode="held"):
    done = simulate(plant_4_1(), law, MOTION_4_1, START_4_1, t1=0.2, period=1e-3, mode=mode, log_every=None)
    effort = jnp.sum(done.tally.torque_square) + jnp.sum(done.tally.late_error) + jnp.sum(done.tally.torque_travel)
    return jnp.stack([jnp.sum(jnp.abs(done.state.q - MOTION_4_1.position(jnp.asarray(0.2)))), effort])


@pytest.mark.parametrize("mode", ["held", pytest.param("continuous", marks=pytest.mark.full)])
def test_gradients_match_differences(mode):
    def final_error(k2):
        return final_error_and_effort(eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2), mode)[0]

    h = 1e-5
    gains = jnp.array([0.6, 0.6 + h, 0.6 - h])
    value_and_slope = jax.jit(jax.vmap(lambda k: jax.jvp(final_error, (k,), (jnp.ones(()),))))
    (_, up, down), (forward, _, _) = value_and_slope(gains)
    difference = float(up - down) / (2 * h)
    assert np.isfinite(forward)
    assert abs(difference) > 1e-3
    assert float(forward) == pytest.approx(difference, rel=1e-6)


# Reverse mode through a whole run takes long to compile; with a simpler law it is tried every day, above.
@pytest.mark.full
def test_gradients_by_every_gain_at_once_are_finite_and_most_of_them_count():
    def final_error(k2):
        return final_error_and_effort(eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2))[0]

    k2 = jnp.asarray(0.6)
    forward = jax.jit(jax.jacfwd(final_error))(k2)
    reverse = jax.jit(jax.jacrev(final_error_and_effort))(eqx.tree_at(lambda c: c.surface.k2, law_4_1(), k2))
    assert float(reverse.surface.k2[0]) == pytest.approx(float(forward), rel=1e-9)
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(reverse)]
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)
    assert sum(np.any(leaf[1] != 0) for leaf in leaves) >= 15


@pytest.mark.full
def test_the_gradient_by_the_arms_own_mass_is_there_too():
    """Plant and nominal robot are leaves like the gains: what identification and design both need."""

    def final_angle(plant):
        end = simulate(plant, SPRING, MOTION_4_1, START_4_1, t1=0.3, period=0.01, log_every=None)
        return end.state.q[0]

    gradient = jax.jit(jax.grad(final_angle))(SMOOTH_PLANT)
    h = 1e-5

    def shifted(d):
        plant = eqx.tree_at(lambda p: p.robot.masses, SMOOTH_PLANT, SMOOTH_PLANT.robot.masses + jnp.array([0.0, d]))
        return float(final_angle(plant))

    difference = (shifted(h) - shifted(-h)) / (2 * h)
    assert float(gradient.robot.masses[1]) == pytest.approx(difference, rel=1e-6)


def test_a_sweep_over_gains_is_compiled_once():
    traces = []

    @jax.jit
    def many(k2):
        traces.append(1)
        return jax.vmap(lambda k: at_1_khz(k, t1=0.1).tally.torque_square)(k2)

    for factor in (1.0, 1.1, 1.2):
        many(GAINS * factor)
    assert len(traces) == 1
