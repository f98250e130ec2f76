import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import Mismatch, panda
from slidax.arms.adjusted import PAYLOAD, Adjusted, inertial_regressor
from slidax.arms.pseudo_inertia import body_of, eigen, least_eigenvalue, nearest_body, pseudo_inertia

RNG = np.random.default_rng(4)
FACTORS = RNG.uniform(-0.3, 0.3, 7)
BODY = np.array([1.5, 0.1, -0.2, 0.3, 0.06, 0.05, 0.04, 0.01, -0.02, 0.015])
Q, DQ, DDQ = jnp.asarray(RNG.normal(size=(3, 7)))
PARAMETERS = np.concatenate([BODY, 1.0 + FACTORS])


@pytest.fixture(scope="module")
def adjusted():
    return Adjusted.of(panda(), jnp.asarray(FACTORS), jnp.asarray(BODY))


def test_adjusted_arm_has_the_dynamics_of_the_arm_with_the_same_mismatch(adjusted):
    inertial = np.zeros((11, 7))
    inertial[:PAYLOAD, 6] = BODY
    true = Mismatch(mass_factor=1.0 + FACTORS, inertial=inertial).applied(panda())
    np.testing.assert_allclose(adjusted.mass(Q), true.mass(Q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(adjusted.bias(Q, DQ), true.bias(Q, DQ), rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        adjusted.potential(Q) - adjusted.potential(0 * Q), true.potential(Q) - true.potential(0 * Q)
    )


def test_torque_regressor_times_parameters_gives_the_torque(adjusted):
    regressor = inertial_regressor(panda(), Q, DQ, DDQ)
    links = adjusted.mass(Q) - jnp.diag(panda().armature)
    np.testing.assert_allclose(regressor.torque @ PARAMETERS, links @ DDQ + adjusted.bias(Q, DQ), rtol=0, atol=1e-12)


def test_inertia_regressor_times_parameters_gives_the_inertia_diagonal(adjusted):
    regressor = inertial_regressor(panda(), Q, DQ, DDQ)
    links = np.diagonal(adjusted.mass(Q)) - panda().armature
    np.testing.assert_allclose(regressor.inertia @ PARAMETERS, links, rtol=0, atol=1e-13)


def test_jacobi_rotations_give_the_eigenvalues_of_lapack():
    for _ in range(20):
        matrix = RNG.normal(size=(4, 4)) * 10.0 ** RNG.uniform(-3, 1, (4, 1))
        matrix = matrix + matrix.T
        values, vectors = eigen(jnp.asarray(matrix))
        np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(vectors @ np.diag(values) @ vectors.T, matrix, atol=1e-12)


def test_nearest_body_is_physical_and_keeps_a_physical_body():
    np.testing.assert_allclose(body_of(pseudo_inertia(jnp.asarray(BODY))), BODY, atol=1e-15)
    impossible = BODY * np.array([1, 1, 1, 1, 0.1, 1, 1, 1, 1, 1])
    assert np.linalg.eigvalsh(pseudo_inertia(jnp.asarray(impossible))).min() < -0.01
    mended = nearest_body(jnp.asarray(impossible), 1e-3)
    np.testing.assert_allclose(np.linalg.eigvalsh(pseudo_inertia(mended)).min(), 1e-3)
    np.testing.assert_allclose(nearest_body(mended, 1e-3), mended, atol=1e-12)


def test_gradient_of_the_least_eigenvalue_agrees_with_finite_differences():
    value, slope = least_eigenvalue(jnp.asarray(BODY))
    for k in range(PAYLOAD):
        moved, _ = least_eigenvalue(jnp.asarray(BODY + 1e-6 * np.eye(PAYLOAD)[k]))
        np.testing.assert_allclose(slope[k], (moved - value) / 1e-6, atol=1e-4)
