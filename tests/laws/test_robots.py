"""Every robot is a rigid arm with consistent matrices.

`mechanics` compiles all compared quantities of an arm at once.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import State
from tests.arms.members import LIKE_OTHERS, ROBOTS
from tests.enrolled import assert_float_leaves, every

SAMPLES = 200
EVERY = every("robot", ROBOTS, full=LIKE_OTHERS, scope="module")


def random_states(robot):
    """Positions, velocities and torques."""
    shape = (SAMPLES, robot.joints)
    rng = np.random.default_rng(0)
    q, dq = rng.uniform(-np.pi, np.pi, shape), rng.normal(size=shape) * 2.0
    return jnp.asarray(q), jnp.asarray(dq), jnp.asarray(np.random.default_rng(3).normal(size=shape) * 10.0)


@eqx.filter_jit
def mechanics(robot, q, dq, tau):
    def at(q, dq, tau):
        state = State(q, dq)
        mass, mass_rate = jax.jvp(robot.mass, (q,), (dq,))
        acceleration = robot.acceleration(state, tau)
        return {
            "mass": mass,
            "mass_rate": mass_rate,
            "coriolis": robot.coriolis(q, dq),
            "bias": robot.bias(q, dq),
            "gravity": robot.gravity(q),
            "potential_slope": jax.grad(robot.potential)(q),
            "acceleration": acceleration,
            "energy_rate": jax.jvp(robot.energy, (state,), (State(q=dq, dq=acceleration),))[1],
            "tip": robot.tip(q),
        }

    return jax.vmap(at)(q, dq, tau)


@pytest.fixture(scope="module")
def states(robot):
    return random_states(robot)


@pytest.fixture(scope="module")
def mechanical(robot, states):
    return jax.tree.map(np.asarray, mechanics(robot, *states))


@EVERY
def test_inertia_is_symmetric_and_positive_definite(robot, mechanical):
    mass = mechanical["mass"]
    np.testing.assert_allclose(mass, mass.swapaxes(1, 2), rtol=0, atol=1e-14)
    assert np.linalg.eigvalsh(mass).min() > 0


@EVERY
def test_inertia_rate_minus_twice_coriolis_is_skew_symmetric(robot, mechanical):
    n = mechanical["mass_rate"] - 2.0 * mechanical["coriolis"]
    np.testing.assert_allclose(n, -n.swapaxes(1, 2), rtol=0, atol=1e-12)
    assert np.abs(n).max() > 1e-3


@EVERY
def test_the_bias_is_coriolis_times_velocity_plus_gravity(robot, states, mechanical):
    parts = np.einsum("kij,kj->ki", mechanical["coriolis"], states[1]) + mechanical["gravity"]
    np.testing.assert_allclose(mechanical["bias"], parts, rtol=1e-12, atol=1e-12)


@EVERY
def test_gravity_is_the_gradient_of_the_potential(robot, mechanical):
    np.testing.assert_allclose(mechanical["gravity"], mechanical["potential_slope"], rtol=1e-12, atol=1e-12)


@EVERY
def test_the_acceleration_solves_the_equation_of_motion(robot, states, mechanical):
    back = np.einsum("kij,kj->ki", mechanical["mass"], mechanical["acceleration"]) + mechanical["bias"]
    np.testing.assert_allclose(back, states[2], rtol=1e-10, atol=1e-10)


@EVERY
def test_input_power_is_the_rate_of_energy(robot, states, mechanical):
    _, dq, tau = states
    np.testing.assert_allclose(mechanical["energy_rate"], np.sum(tau * dq, axis=1), rtol=0, atol=1e-9)


@eqx.filter_jit
def moved_freely(robot, start, span, steps):
    """Classical Runge-Kutta method; a loop over its stages compiles four times faster."""
    h = span / steps

    def rate(state):
        return State(q=state.dq, dq=robot.acceleration(state, jnp.zeros(robot.joints)))

    def stage(carry, weights):
        state, total, last = carry
        ahead, weight = weights
        slope = rate(jax.tree.map(lambda x, k: x + ahead * h * k, state, last))
        return (state, jax.tree.map(lambda x, k: x + weight * h * k, total, slope), slope), None

    def step(_, state):
        still = jax.tree.map(jnp.zeros_like, state)
        weights = jnp.asarray([0.0, 0.5, 0.5, 1.0]), jnp.asarray([1.0, 2.0, 2.0, 1.0]) / 6.0
        return jax.lax.scan(stage, (state, state, still), weights)[0][1]

    return jax.lax.fori_loop(0, steps, step, start)


@eqx.filter_jit
def energies(robot, states):
    """Total and potential energies of several states."""
    return jax.vmap(robot.energy)(states), jax.vmap(robot.potential)(states.q)


def a_start(robot):
    rng = np.random.default_rng(5)
    return State(q=jnp.asarray(rng.normal(size=robot.joints)), dq=jnp.asarray(rng.normal(size=robot.joints)))


@EVERY
def test_an_unforced_arm_keeps_its_energy_to_the_integrators_order(robot):
    start = a_start(robot)
    # An arm with six joints tumbles, and the sign of its error varies with the number of steps.
    halvings = 3 if robot.joints >= 6 else 1
    # The number of steps is an array, so that one compilation serves both numbers.
    numbers = (10_000, 10_000 * 2**halvings)
    ends = [moved_freely(robot, start, jnp.asarray(5.0), jnp.asarray(steps)) for steps in numbers]
    energy, potential = energies(robot, jax.tree.map(lambda *x: jnp.stack(x), start, *ends))
    coarse, fine = np.abs(energy[1:] - energy[0])
    scale = max(1.0, float(np.abs(energy[0])), float(np.max(energy[1:] - potential[1:])))
    assert abs(float(ends[1].q[0] - start.q[0])) > 0.1 and fine < 1e-6 * scale
    assert fine < coarse / 2 ** (3.5 if halvings == 1 else 3.0 * halvings) or fine < 1e-10 * scale


@EVERY
def test_torque_units_follow_from_the_joint_units(robot):
    assert len(robot.joint_units) == robot.joints and set(robot.joint_units) <= {"rad", "m"}
    expected = tuple({"rad": "N m", "m": "N"}[unit] for unit in robot.joint_units)
    assert robot.torque_units == expected


@EVERY
def test_tip_and_inertia_are_unchanged_by_a_full_turn_of_the_joints(robot, states, mechanical):
    q, dq, tau = states
    turn = jnp.asarray([2 * np.pi if unit == "rad" else 0.0 for unit in robot.joint_units])
    turned = mechanics(robot, q + turn, dq, tau)
    np.testing.assert_allclose(turned["tip"], mechanical["tip"], atol=1e-13)
    np.testing.assert_allclose(turned["mass"], mechanical["mass"], atol=1e-12)


@eqx.filter_jit
@jax.grad
def effect_of_parameters(robot):
    n = robot.joints
    return jnp.sum(robot.acceleration(State(jnp.ones(n), jnp.ones(n)), jnp.arange(1.0, n + 1.0)))


@EVERY
def test_every_parameter_of_the_robot_is_a_differentiable_leaf(robot):
    assert_float_leaves(robot)
    gradient = jax.tree.leaves(effect_of_parameters(robot))
    assert all(np.all(np.isfinite(leaf)) for leaf in gradient)
    assert any(np.any(np.asarray(leaf) != 0) for leaf in gradient)
