"""What every robot must be: a rigid arm whose matrices belong together."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from tests.enrolled import every
from tests.robots.members import LIKE_PANDA, ROBOTS

SAMPLES = 200


def random_states(robot, seed=0):
    rng = np.random.default_rng(seed)
    shape = (SAMPLES, robot.joints)
    return jnp.asarray(rng.uniform(-np.pi, np.pi, shape)), jnp.asarray(rng.normal(size=shape) * 2.0)


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_inertia_is_symmetric_and_positive_definite(robot):
    q, _ = random_states(robot)
    mass = np.asarray(jax.jit(jax.vmap(robot.mass))(q))
    np.testing.assert_allclose(mass, mass.swapaxes(1, 2), rtol=0, atol=1e-14)
    assert np.linalg.eigvalsh(mass).min() > 0


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_the_rate_of_inertia_less_twice_coriolis_is_skew(robot):
    q, dq = random_states(robot)

    def defect(q, dq):
        mass_rate = jax.jvp(robot.mass, (q,), (dq,))[1]
        return mass_rate - 2.0 * robot.coriolis(q, dq)

    n = np.asarray(jax.jit(jax.vmap(defect))(q, dq))
    np.testing.assert_allclose(n, -n.swapaxes(1, 2), rtol=0, atol=1e-12)
    assert np.abs(n).max() > 1e-3


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_the_bias_is_coriolis_times_velocity_plus_gravity(robot):
    q, dq = random_states(robot)
    bias = jax.jit(jax.vmap(robot.bias))(q, dq)
    parts = jax.jit(jax.vmap(lambda q, dq: robot.coriolis(q, dq) @ dq + robot.gravity(q)))(q, dq)
    np.testing.assert_allclose(bias, parts, rtol=1e-12, atol=1e-12)


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_gravity_is_the_gradient_of_the_potential(robot):
    q, _ = random_states(robot)
    np.testing.assert_allclose(
        jax.jit(jax.vmap(robot.gravity))(q), jax.jit(jax.vmap(jax.grad(robot.potential)))(q), rtol=1e-12, atol=1e-12
    )


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_the_acceleration_solves_the_equation_of_motion(robot):
    q, dq = random_states(robot)
    tau = jnp.asarray(np.random.default_rng(3).normal(size=q.shape) * 10.0)
    ddq = jax.jit(jax.vmap(lambda q, dq, tau: robot.acceleration(State(q, dq), tau)))(q, dq, tau)
    back = jax.jit(jax.vmap(lambda q, dq, ddq: robot.mass(q) @ ddq + robot.bias(q, dq)))(q, dq, ddq)
    np.testing.assert_allclose(back, tau, rtol=1e-10, atol=1e-10)


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_power_in_is_the_rate_of_energy(robot):
    q, dq = random_states(robot)
    tau = jnp.asarray(np.random.default_rng(4).normal(size=q.shape) * 10.0)

    def balance(q, dq, tau):
        rate = State(q=dq, dq=robot.acceleration(State(q, dq), tau))
        return jax.jvp(robot.energy, (State(q, dq),), (rate,))[1] - jnp.dot(tau, dq)

    np.testing.assert_allclose(jax.jit(jax.vmap(balance))(q, dq, tau), 0.0, atol=1e-9)


def moved_freely(robot, start, span, steps):
    """By the classical Runge-Kutta method, whose stages are a loop here: it is compiled four times faster so."""
    h = span / steps

    def rate(state):
        return State(q=state.dq, dq=robot.acceleration(state, jnp.zeros(robot.joints)))

    def stage(carry, weights):
        state, total, last = carry
        ahead, weight = weights
        slope = rate(jax.tree.map(lambda x, k: x + ahead * h * k, state, last))
        return (state, jax.tree.map(lambda x, k: x + weight * h * k, total, slope), slope), None

    def step(state, _):
        still = jax.tree.map(jnp.zeros_like, state)
        weights = jnp.asarray([0.0, 0.5, 0.5, 1.0]), jnp.asarray([1.0, 2.0, 2.0, 1.0]) / 6.0
        return jax.lax.scan(stage, (state, state, still), weights)[0][1], None

    return jax.jit(lambda state: jax.lax.scan(step, state, None, length=steps)[0])(start)


def a_start(robot):
    rng = np.random.default_rng(5)
    return State(q=jnp.asarray(rng.normal(size=robot.joints)), dq=jnp.asarray(rng.normal(size=robot.joints)))


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_an_unforced_arm_keeps_its_energy_to_the_integrators_order(robot):
    start = a_start(robot)

    @jax.jit
    def drift(start, ends):
        energy = robot.energy(start)
        moving = jax.vmap(robot.energy)(ends) - jax.vmap(robot.potential)(ends.q)
        return jnp.abs(jax.vmap(robot.energy)(ends) - energy), jnp.maximum(jnp.abs(energy), jnp.max(moving))

    ends = [moved_freely(robot, start, 10.0, steps) for steps in (20_000, 40_000)]
    (coarse, fine), size = drift(start, jax.tree.map(lambda *x: jnp.stack(x), *ends))
    scale = max(1.0, float(size))
    assert abs(float(ends[1].q[0] - start.q[0])) > 0.1
    assert fine < 1e-6 * scale
    assert fine < coarse / 2**3.5 or fine < 1e-10 * scale


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_units_fit_the_joints(robot):
    assert len(robot.joint_units) == robot.joints
    assert set(robot.joint_units) <= {"rad", "m"}
    expected = tuple({"rad": "N m", "m": "N"}[unit] for unit in robot.joint_units)
    assert robot.torque_units == expected


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_the_arm_looks_the_same_after_a_full_turn(robot):
    q, _ = random_states(robot)
    turn = jnp.asarray([2 * np.pi if unit == "rad" else 0.0 for unit in robot.joint_units])
    np.testing.assert_allclose(jax.jit(jax.vmap(robot.tip))(q + turn), jax.jit(jax.vmap(robot.tip))(q), atol=1e-13)
    np.testing.assert_allclose(jax.jit(jax.vmap(robot.mass))(q + turn), jax.jit(jax.vmap(robot.mass))(q), atol=1e-12)


@every("robot", ROBOTS, full=LIKE_PANDA)
def test_every_parameter_of_the_robot_is_a_differentiable_leaf(robot):
    leaves = jax.tree.leaves(robot)
    assert leaves
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in leaves)
    n = robot.joints

    def effect(robot):
        return jnp.sum(robot.acceleration(State(jnp.ones(n), jnp.ones(n)), jnp.arange(1.0, n + 1.0)))

    gradient = jax.tree.leaves(jax.grad(effect)(robot))
    assert all(np.all(np.isfinite(leaf)) for leaf in gradient)
    assert any(np.any(np.asarray(leaf) != 0) for leaf in gradient)
