"""The two integrators: convergence order, stages and exactness."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core import runge_kutta_4, semi_implicit_euler, value_rate_curvature
from slidax.core.types import State


def pendulum(t, state):
    return State(q=state.dq, dq=-jnp.sin(state.q) + 0.1 * jnp.cos(3.0 * t)), t


def endpoint(step, steps):
    h = jnp.asarray(2.0 / steps)

    def advance(state, k):
        return step(pendulum, k * h, state, h)[0], None

    start = State(q=jnp.array([1.0]), dq=jnp.array([0.0]))
    final = jax.jit(lambda: jax.lax.scan(advance, start, jnp.arange(float(steps)))[0])()
    return np.concatenate([final.q, final.dq])


def order(step, steps):
    """log2 of the ratio of two successive differences under halving."""
    coarse, middle, fine = (endpoint(step, n) for n in (steps, 2 * steps, 4 * steps))
    return np.log2(np.abs(coarse - middle).max() / np.abs(middle - fine).max())


@pytest.mark.parametrize(
    ("step", "steps", "expected"), [(runge_kutta_4, 20, 4.0), (semi_implicit_euler, 200, 1.0)], ids=["rk4", "euler"]
)
def test_each_integrator_converges_at_its_order(step, steps, expected):
    assert order(step, steps) == pytest.approx(expected, abs=0.15 if expected == 4.0 else 0.05)


def test_runge_kutta_evaluates_its_four_stages_in_order():
    start = State(q=jnp.array([1.0]), dq=jnp.array([0.0]))
    _, times = runge_kutta_4(pendulum, jnp.asarray(2.0), start, jnp.asarray(0.5))
    assert [float(t) for t in times] == [2.0, 2.25, 2.25, 2.5]


def test_semi_implicit_euler_evaluates_once_and_moves_with_the_new_velocity():
    start = State(q=jnp.array([1.0]), dq=jnp.array([0.5]))
    after, times = semi_implicit_euler(pendulum, jnp.asarray(2.0), start, jnp.asarray(0.1))
    dq = 0.5 + 0.1 * (-np.sin(1.0) + 0.1 * np.cos(6.0))
    assert [float(t) for t in times] == [2.0]
    assert float(after.dq[0]) == pytest.approx(dq, rel=1e-15)
    assert float(after.q[0]) == pytest.approx(1.0 + 0.1 * dq, rel=1e-15)


def test_runge_kutta_integrates_a_cubic_in_time_exactly():
    def cubic(t, state):
        return State(q=jnp.array([4.0]) * t**3, dq=jnp.zeros(1)), None

    start = State(q=jnp.zeros(1), dq=jnp.zeros(1))
    after, _ = runge_kutta_4(cubic, jnp.asarray(0.0), start, jnp.asarray(1.5))
    assert float(after.q[0]) == pytest.approx(1.5**4, rel=1e-15)


def test_value_rate_curvature_returns_a_function_and_its_two_time_derivatives():
    t = jnp.asarray(0.7)
    value, rate, curvature = value_rate_curvature(lambda t: jnp.stack([jnp.sin(2.0 * t), t**3]), t)
    np.testing.assert_allclose(value, [np.sin(1.4), 0.343], rtol=1e-14)
    np.testing.assert_allclose(rate, [2 * np.cos(1.4), 3 * 0.49], rtol=1e-14)
    np.testing.assert_allclose(curvature, [-4 * np.sin(1.4), 6 * 0.7], rtol=1e-14)
