"""Torque limits: the feasible torque whose acceleration is nearest to the desired acceleration (Gauss)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from slidax.core import nearest_in_box

nearest = jax.jit(nearest_in_box)


def arm(n, rng):
    """A random inertia matrix with coupling as strong as in an arm."""
    root = rng.normal(size=(n, n))
    return jnp.asarray(root @ root.T + 0.5 * np.eye(n))


def test_a_torque_inside_the_limits_is_returned_bit_for_bit():
    wanted = jnp.array([0.3, -1.0])
    torque = nearest(wanted, jnp.full(2, -jnp.inf), jnp.array([0.3, jnp.inf]), arm(2, np.random.default_rng(0)))
    np.testing.assert_array_equal(torque, wanted)


@pytest.mark.parametrize("n", [2, 3, 7])
def test_the_limited_torque_minimises_the_weighted_acceleration_error(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        mass, wanted = arm(n, rng), jnp.asarray(rng.normal(size=n) * 5)
        lower, upper = jnp.asarray(-rng.uniform(0.1, 3, n)), jnp.asarray(rng.uniform(0.1, 3, n))
        torque = np.asarray(nearest(wanted, lower, upper, mass))
        assert np.all((torque >= lower) & (torque <= upper))
        inverse, goal = np.linalg.inv(mass), np.asarray(wanted)

        def cost(x, inverse=inverse, goal=goal):
            return (x - goal) @ inverse @ (x - goal)

        bounds = list(zip(np.asarray(lower), np.asarray(upper), strict=True))
        reference = minimize(cost, np.clip(wanted, lower, upper), bounds=bounds, tol=1e-14)
        assert cost(torque) <= reference.fun * (1 + 1e-6) + 1e-9


def test_a_joint_without_a_torque_limit_keeps_its_acceleration_while_another_saturates():
    mass = jnp.array([[2.0, 0.9], [0.9, 1.0]])
    wanted = mass @ jnp.array([10.0, -1.0])
    limit = jnp.array([5.0, jnp.inf])
    torque = nearest(wanted, -limit, limit, mass)
    assert torque[0] == 5.0
    np.testing.assert_allclose(np.linalg.solve(mass, torque)[1], -1.0, rtol=1e-12)
    clipped = np.linalg.solve(mass, np.clip(wanted, -limit, limit))[1]
    assert abs(clipped + 1.0) > 3.0
