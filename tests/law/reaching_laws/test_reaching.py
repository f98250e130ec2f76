"""The reaching law (43), (44), (51) and the size of its robust torque (45), (46)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import State
from slidax.law import FixedTimeReaching, UncertaintyBound

S = np.array([0.3, -0.4])
SIG = np.abs(S) ** 1.2 * np.sign(S)
BOUND = UncertaintyBound(0.09, 0.2, 12.0, 2.2, 2.8, 1.0)


@pytest.mark.parametrize(
    ("gain", "matrix"),
    [
        (0.1, 0.1 * np.eye(2)),
        ([0.1, 0.3], np.diag([0.1, 0.3])),
        ([[0.2, 0.1], [0.1, 0.4]], np.array([[0.2, 0.1], [0.1, 0.4]])),
    ],
    ids=["number", "diagonal", "matrix"],
)
def test_the_power_is_the_gain_times_sig_r(gain, matrix):
    np.testing.assert_allclose(FixedTimeReaching(gain, 1.2).continuous_term(jnp.asarray(S)), matrix @ SIG, rtol=1e-14)


def test_without_a_layer_the_direction_is_the_unit_vector():
    np.testing.assert_allclose(FixedTimeReaching(0.1, 1.2).switching_direction(jnp.asarray(S)), [0.6, -0.8], rtol=1e-15)


def test_with_a_layer_the_direction_is_shorter_by_it():
    direction = FixedTimeReaching(0.1, 1.2, 0.05).switching_direction(jnp.asarray(S))
    np.testing.assert_allclose(direction, S / 0.55, rtol=1e-15)


@pytest.mark.parametrize("layer", [0.0, 0.05])
def test_at_zero_the_direction_is_zero_with_finite_gradients(layer):
    reaching = FixedTimeReaching(0.1, 1.2, layer)
    np.testing.assert_array_equal(reaching.switching_direction(jnp.zeros(2)), 0.0)
    np.testing.assert_array_equal(reaching.continuous_term(jnp.zeros(2)), 0.0)
    for part in ("switching_direction", "continuous_term"):
        by_gains, by_s = jax.grad(lambda r, s: jnp.sum(getattr(r, part)(s)), argnums=(0, 1))(reaching, jnp.zeros(2))  # noqa: B023
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((by_gains, by_s)))


def test_the_robust_torque_is_that_of_eqs_45_and_46():
    q, dq, tau = np.array([0.5, -1.0]), np.array([2.0, 0.5]), np.array([30.0, -40.0])
    gamma = (0.2 - 0.09) / (0.2 + 0.09)
    u = (1.0 + 12.0 + 2.2 * np.linalg.norm(q) + 2.8 * np.linalg.norm(dq) ** 2 + gamma * 50.0) / (1 - gamma)
    state = State(q=jnp.asarray(q), dq=jnp.asarray(dq))
    assert float(BOUND(state, jnp.asarray(tau))) == pytest.approx(u, rel=1e-14)
    assert float(BOUND.gamma) == pytest.approx(gamma, rel=1e-15)
    assert float(BOUND.gamma) == pytest.approx(0.379, abs=5e-4)


def test_the_robust_torque_covers_the_uncertainty_it_is_made_for():
    """`u >= b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ0 + τ1 + τ2‖ + k` for any direction: why (45) divides by 1 - γ."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        q, dq, tau = rng.normal(size=(3, 2)) * [[1.0], [2.0], [50.0]]
        u = float(BOUND(State(q=jnp.asarray(q), dq=jnp.asarray(dq)), jnp.asarray(tau)))
        direction = rng.normal(size=2)
        direction /= np.linalg.norm(direction)
        known = 12.0 + 2.2 * np.linalg.norm(q) + 2.8 * np.linalg.norm(dq) ** 2
        total = np.linalg.norm(tau - u * direction)
        assert u >= known + float(BOUND.gamma) * total + 1.0 - 1e-9


def test_the_robust_torque_has_finite_gradients_at_rest_without_torque():
    state = State(q=jnp.zeros(2), dq=jnp.zeros(2))
    gradient = jax.grad(lambda b, s, tau: b(s, tau), argnums=(0, 1, 2))(BOUND, state, jnp.zeros(2))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))
