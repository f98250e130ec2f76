"""What every robot must be: a rigid arm whose matrices belong together."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from slidax._types import State
from slidax.numerics import runge_kutta_4
from tests.enrolled import every
from tests.robots.members import ROBOTS

SAMPLES = 200


def random_states(robot, seed=0):
    rng = np.random.default_rng(seed)
    shape = (SAMPLES, robot.joints)
    return jnp.asarray(rng.uniform(-np.pi, np.pi, shape)), jnp.asarray(rng.normal(size=shape) * 2.0)


@every("robot", ROBOTS)
def test_inertia_is_symmetric_and_positive_definite(robot):
    q, _ = random_states(robot)
    mass = np.asarray(jax.jit(jax.vmap(robot.mass))(q))
    np.testing.assert_allclose(mass, mass.swapaxes(1, 2), rtol=0, atol=1e-14)
    assert np.linalg.eigvalsh(mass).min() > 0


@every("robot", ROBOTS)
def test_the_rate_of_inertia_less_twice_coriolis_is_skew(robot):
    q, dq = random_states(robot)

    def defect(q, dq):
        mass_rate = jax.jvp(robot.mass, (q,), (dq,))[1]
        return mass_rate - 2.0 * robot.coriolis(q, dq)

    n = np.asarray(jax.jit(jax.vmap(defect))(q, dq))
    np.testing.assert_allclose(n, -n.swapaxes(1, 2), rtol=0, atol=1e-12)
    assert np.abs(n).max() > 1e-3


@every("robot", ROBOTS)
def test_the_bias_is_coriolis_times_velocity_plus_gravity(robot):
    q, dq = random_states(robot)
    bias = jax.jit(jax.vmap(robot.bias))(q, dq)
    parts = jax.jit(jax.vmap(lambda q, dq: robot.coriolis(q, dq) @ dq + robot.gravity(q)))(q, dq)
    np.testing.assert_allclose(bias, parts, rtol=1e-12, atol=1e-12)


@every("robot", ROBOTS)
def test_gravity_is_the_gradient_of_the_potential(robot):
    q, _ = random_states(robot)
    np.testing.assert_allclose(
        jax.jit(jax.vmap(robot.gravity))(q), jax.jit(jax.vmap(jax.grad(robot.potential)))(q), rtol=1e-12, atol=1e-12
    )


@every("robot", ROBOTS)
def test_the_acceleration_solves_the_equation_of_motion(robot):
    q, dq = random_states(robot)
    tau = jnp.asarray(np.random.default_rng(3).normal(size=q.shape) * 10.0)
    ddq = jax.jit(jax.vmap(lambda q, dq, tau: robot.acceleration(State(q, dq), tau)))(q, dq, tau)
    back = jax.jit(jax.vmap(lambda q, dq, ddq: robot.mass(q) @ ddq + robot.bias(q, dq)))(q, dq, ddq)
    np.testing.assert_allclose(back, tau, rtol=1e-10, atol=1e-10)


@every("robot", ROBOTS)
def test_power_in_is_the_rate_of_energy(robot):
    q, dq = random_states(robot)
    tau = jnp.asarray(np.random.default_rng(4).normal(size=q.shape) * 10.0)

    def balance(q, dq, tau):
        rate = State(q=dq, dq=robot.acceleration(State(q, dq), tau))
        return jax.jvp(robot.energy, (State(q, dq),), (rate,))[1] - jnp.dot(tau, dq)

    np.testing.assert_allclose(jax.jit(jax.vmap(balance))(q, dq, tau), 0.0, atol=1e-9)


def unforced(robot, t, state):
    return State(q=state.dq, dq=robot.acceleration(state, jnp.zeros(robot.joints))), None


def a_start(robot):
    rng = np.random.default_rng(5)
    return State(q=jnp.asarray(rng.normal(size=robot.joints)), dq=jnp.asarray(rng.normal(size=robot.joints)))


@every("robot", ROBOTS)
def test_an_unforced_arm_keeps_its_energy(robot):
    n, start = robot.joints, a_start(robot)
    rate = jax.jit(lambda y: robot.acceleration(State(y[:n], y[n:]), jnp.zeros(n)))
    solution = solve_ivp(
        lambda t, y: np.concatenate([y[n:], rate(jnp.asarray(y))]),
        (0.0, 3.0),
        np.concatenate([start.q, start.dq]),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    energy = [float(robot.energy(State(jnp.asarray(y[:n]), jnp.asarray(y[n:])))) for y in solution.y.T]
    assert np.ptp(solution.y[0]) > 0.1
    assert np.ptp(energy) < 1e-8 * max(1.0, np.abs(energy).max())


@every("robot", ROBOTS)
def test_runge_kutta_loses_energy_at_its_order_at_least(robot):
    def drift(steps):
        h = jnp.asarray(3.0 / steps)

        def step(state, t):
            return runge_kutta_4(lambda t, y: unforced(robot, t, y), t, state, h)[0], None

        final = jax.jit(lambda y: jax.lax.scan(step, y, jnp.arange(float(steps)) * h)[0])(a_start(robot))
        return abs(float(robot.energy(final) - robot.energy(a_start(robot))))

    coarse, fine = drift(60), drift(120)
    assert coarse < 1e-2
    assert fine < coarse / 2**3.5 or fine < 1e-10


@every("robot", ROBOTS)
def test_units_fit_the_joints(robot):
    assert len(robot.joint_units) == robot.joints
    assert set(robot.joint_units) <= {"rad", "m"}
    expected = tuple({"rad": "N m", "m": "N"}[unit] for unit in robot.joint_units)
    assert robot.torque_units == expected


@every("robot", ROBOTS)
def test_the_arm_looks_the_same_after_a_full_turn(robot):
    q, _ = random_states(robot)
    turn = jnp.asarray([2 * np.pi if unit == "rad" else 0.0 for unit in robot.joint_units])
    np.testing.assert_allclose(jax.jit(jax.vmap(robot.tip))(q + turn), jax.jit(jax.vmap(robot.tip))(q), atol=1e-13)
    np.testing.assert_allclose(jax.jit(jax.vmap(robot.mass))(q + turn), jax.jit(jax.vmap(robot.mass))(q), atol=1e-12)


@every("robot", ROBOTS)
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
