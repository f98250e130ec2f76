"""The reaching law (43), (44), (51), its robust torque (45), (46), and the implicit step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import FixedTimeReaching, TwoPowerReaching, UncertaintyBound
from slidax.law.reaching_laws import PRECISION

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
def test_continuous_term_is_the_gain_times_sig_r(gain, matrix):
    np.testing.assert_allclose(FixedTimeReaching(gain, 1.2).continuous_term(jnp.asarray(S)), matrix @ SIG, rtol=1e-14)


def test_switching_direction_without_a_boundary_layer_is_the_unit_vector():
    np.testing.assert_allclose(FixedTimeReaching(0.1, 1.2).switching_direction(jnp.asarray(S)), [0.6, -0.8], rtol=1e-15)


def test_switching_direction_with_a_boundary_layer_is_s_over_its_length_plus_the_layer():
    direction = FixedTimeReaching(0.1, 1.2, 0.05).switching_direction(jnp.asarray(S))
    np.testing.assert_allclose(direction, S / 0.55, rtol=1e-15)


def test_robust_torque_agrees_with_equations_45_and_46():
    q, dq, tau = np.array([0.5, -1.0]), np.array([2.0, 0.5]), np.array([30.0, -40.0])
    gamma = (0.2 - 0.09) / (0.2 + 0.09)
    u = (1.0 + 12.0 + 2.2 * np.linalg.norm(q) + 2.8 * np.linalg.norm(dq) ** 2 + gamma * 50.0) / (1 - gamma)
    state = State(q=jnp.asarray(q), dq=jnp.asarray(dq))
    assert float(BOUND(state, jnp.asarray(tau))) == pytest.approx(u, rel=1e-14)
    assert float(BOUND.gamma) == pytest.approx(gamma, rel=1e-15)
    assert float(BOUND.gamma) == pytest.approx(0.379, abs=5e-4)


def test_the_robust_torque_covers_the_uncertainty_within_its_bound():
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


CASES = 4000


def cases(seed, joints):
    """Random gains and sizes over five decades, inertias with condition numbers up to 100, with and without layers."""
    random = np.random.default_rng(seed)
    turned = np.linalg.qr(random.normal(size=(CASES, joints, joints)))[0]
    spread = 10.0 ** (random.uniform(-2, 0, (CASES, 1)) * random.uniform(0, 1, (CASES, joints)))
    metric = np.einsum("cij,cj,ckj->cik", turned, spread, turned) * 10.0 ** random.uniform(-1, 4, (CASES, 1, 1))
    return [
        jnp.asarray(numbers)
        for numbers in (
            *10.0 ** random.uniform(-2, 3, (2, CASES, joints)),
            1.0 + 10.0 ** random.uniform(-2, 0.5, CASES),
            random.uniform(0.05, 0.99, CASES),
            np.where(random.random(CASES) < 0.5, 0.0, 10.0 ** random.uniform(-6, 0, CASES)),
            0.5 * (metric + metric.transpose(0, 2, 1)),
            random.normal(size=(CASES, joints)) * 10.0 ** random.uniform(-6, 1, (CASES, 1)),
            np.where(random.random(CASES) < 0.2, 0.0, 10.0 ** random.uniform(-3, 3, CASES)),
        )
    ]


def solved(two, joints):
    """Residual of the equation at the computed s⁺ in each case, and its tolerance."""

    def residual(k1, k2, above, below, layer, metric, s, u):
        law = TwoPowerReaching(k1, k2, above, below, layer) if two else FixedTimeReaching(k1, above, layer)
        after = law.implicit(metric, s, u)
        push = metric @ s
        left = jnp.linalg.norm(metric @ after + law.continuous_term_and_slope(after)[0] - push + u * unit(after, layer))
        held = (layer == 0) & (jnp.linalg.norm(push) <= u)
        return jnp.where(held, jnp.linalg.norm(after), left), PRECISION * (1.0 + jnp.linalg.norm(push))

    def unit(s, layer):
        size = jnp.linalg.norm(s)
        return s / jnp.where(size + layer > 0, size + layer, 1.0)

    left, tolerance = jax.jit(jax.vmap(residual))(*cases(joints, joints))
    return np.asarray(left), np.asarray(tolerance)


@pytest.mark.parametrize("joints", [2, pytest.param(7, marks=pytest.mark.full)])
def test_implicit_step_with_an_exponent_above_1_always_converges(joints):
    left, tolerance = solved(False, joints)
    assert np.all(left <= 2 * tolerance)


@pytest.mark.parametrize("joints", [2, pytest.param(7, marks=pytest.mark.full)])
def test_implicit_step_with_an_exponent_below_1_converges_in_995_of_1000_cases(joints):
    """Near s⁺ = 0 the unit vector and the power term both change abruptly; a few cases there miss the tolerance."""
    left, tolerance = solved(True, joints)
    assert np.mean(left <= 2 * tolerance) >= 0.995


@pytest.mark.parametrize("most", [1e13, 1e200])
def test_inverse_inertia_bounds_that_make_u_infinite_are_refused(most):
    with pytest.raises(DefinitionError, match=r"must be at most 1e\+12 times"):
        UncertaintyBound(0.09, most, 12.0, 2.2, 2.8, 1.0)
    assert np.isfinite(
        UncertaintyBound(0.09, 1e10, 12.0, 2.2, 2.8, 1.0)(State(jnp.asarray(S), jnp.asarray(S)), jnp.asarray(S))
    )
