"""The two arms of the paper against their printed matrices, written out here in plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import TwoLink
from tests.paper_examples import SCARA, TWO_LINK, TWO_LINK_NOMINAL

STATES = np.random.default_rng(7).uniform(-3.0, 3.0, (20, 2, 3))


def two_link(l1, l2, m1, m2, i1, i2, g, q, dq):
    """M, C, G of Example 4.1, as the paper prints them."""
    c2, s2, c1, c12 = np.cos(q[1]), np.sin(q[1]), np.cos(q[0]), np.cos(q[0] + q[1])
    m11 = (m1 + m2) * l1**2 + m2 * l2**2 + 2 * m2 * l1 * l2 * c2 + i1
    m12 = m2 * l2**2 + m2 * l1 * l2 * c2
    m22 = m2 * l2**2 + i2
    h = m2 * l1 * l2 * s2
    mass = np.array([[m11, m12], [m12, m22]])
    coriolis = np.array([[-h * dq[1], -h * (dq[0] + dq[1])], [h * dq[0], 0.0]])
    gravity = np.array([(m1 + m2) * l1 * g * c1 + m2 * l2 * g * c12, m2 * l2 * g * c12])
    return mass, coriolis, gravity


def scara(l1, l2, m1, m2, m3, g, q, dq):
    """M, C, G of Example 4.2, as the paper prints them."""
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    a, b, c = (m1 + m2 + m3) * l1**2, (m2 + m3) * l2**2, (m2 + m3) * l1 * l2
    mass = np.array([[a + 2 * c * c2 + b, b + c * c2, 0], [b + c * c2, b, 0], [0, 0, m3]])
    coriolis = np.array([[-c * s2 * dq[1], -c * s2 * (dq[0] + dq[1]), 0], [c * s2 * dq[0], 0, 0], [0, 0, 0]])
    return mass, coriolis, np.array([0.0, 0.0, -m3 * g])


ARMS = [
    pytest.param(TWO_LINK, lambda q, dq: two_link(1.0, 0.8, 0.5, 1.5, 5.0, 5.0, 9.8, q, dq), id="two_link"),
    pytest.param(TWO_LINK_NOMINAL, lambda q, dq: two_link(1.0, 0.8, 0.6, 1.8, 6.0, 6.0, 9.8, q, dq), id="nominal"),
    pytest.param(SCARA, lambda q, dq: scara(0.3, 0.4, 2.0, 2.0, 1.0, 9.8, q, dq), id="scara"),
]


@pytest.mark.parametrize(("robot", "printed"), ARMS)
def test_inertia_coriolis_and_gravity_agree_with_the_printed_formulas(robot, printed):
    for q, dq in STATES[:, :, : robot.joints]:
        mass, coriolis, gravity = printed(q, dq)
        np.testing.assert_allclose(robot.mass(jnp.asarray(q)), mass, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(robot.coriolis(jnp.asarray(q), jnp.asarray(dq)), coriolis, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(robot.gravity(jnp.asarray(q)), gravity, rtol=1e-13, atol=1e-13)
        bias = coriolis @ dq + gravity
        np.testing.assert_allclose(robot.bias(jnp.asarray(q), jnp.asarray(dq)), bias, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("arm", "q", "tip"),
    [
        (TWO_LINK, [0.0, 0.0], [1.8, 0.0, 0.0]),
        (TWO_LINK, [np.pi / 2, -np.pi / 2], [0.8, 1.0, 0.0]),
        (SCARA, [0.0, 0.0, 0.25], [0.7, 0.0, -0.25]),
        (SCARA, [np.pi / 2, np.pi / 2, 0.0], [-0.4, 0.3, 0.0]),
    ],
)
def test_tip_agrees_with_geometry(arm, q, tip):
    np.testing.assert_allclose(arm.tip(jnp.array(q)), tip, atol=1e-15)


def test_inverse_inertia_eigenvalues_agree_with_table_1():
    angles = jnp.stack([jnp.zeros(721), jnp.linspace(-np.pi, np.pi, 721)], axis=1)
    eigenvalues = 1.0 / np.linalg.eigvalsh(jax.vmap(TWO_LINK.mass)(angles))
    assert eigenvalues.min() == pytest.approx(0.089, abs=5e-4)
    assert eigenvalues.max() == pytest.approx(0.197, abs=5e-4)


def test_nominal_inertia_of_example_4_1_is_off_by_at_most_20_percent():
    angles = jnp.stack([jnp.zeros(91), jnp.linspace(-np.pi, np.pi, 91)], axis=1)
    true, nominal = jax.vmap(TWO_LINK.mass)(angles), jax.vmap(TWO_LINK_NOMINAL.mass)(angles)
    mismatch = np.linalg.solve(true, nominal) - np.eye(2)
    assert np.linalg.norm(mismatch, ord=2, axis=(1, 2)).max() == pytest.approx(0.2, abs=1e-3)


def test_default_gravity_is_9_8():
    assert float(TwoLink([1.0, 1.0], [1.0, 1.0], [0.0, 0.0]).gravity_acceleration) == 9.8
