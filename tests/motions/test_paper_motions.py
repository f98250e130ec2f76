"""The motions of the two examples against their closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.motions import ConstantPosture
from tests.paper_examples import MOTION_4_1, MOTION_4_2

TIMES = np.linspace(0.0, 20.0, 101)


def test_example_4_1_follows_two_exponentials():
    a, b = np.exp(-TIMES), np.exp(-4 * TIMES)
    q = np.stack([1.25 - 7 / 5 * a + 7 / 20 * b, 1.25 + a - b / 4], axis=1)
    dq = np.stack([7 / 5 * a - 7 / 5 * b, -a + b], axis=1)
    ddq = np.stack([-7 / 5 * a + 28 / 5 * b, a - 4 * b], axis=1)
    reference = jax.vmap(MOTION_4_1.reference)(jnp.asarray(TIMES))
    np.testing.assert_allclose(reference.q, q, rtol=1e-14)
    np.testing.assert_allclose(reference.dq, dq, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(reference.ddq, ddq, rtol=1e-13, atol=1e-15)


def test_example_4_2_follows_sinusoids():
    w = np.pi / 5
    s, c = np.sin(w * TIMES), np.cos(w * TIMES)
    reference = jax.vmap(MOTION_4_2.reference)(jnp.asarray(TIMES))
    np.testing.assert_allclose(reference.q, np.stack([s, 1.5 * c, 1 + 0.5 * s], axis=1), atol=1e-14)
    np.testing.assert_allclose(reference.dq, w * np.stack([c, -1.5 * s, 0.5 * c], axis=1), atol=1e-14)
    np.testing.assert_allclose(reference.ddq, -(w**2) * np.stack([s, 1.5 * c, 0.5 * s], axis=1), atol=1e-14)


@pytest.mark.parametrize("t", [0.0, 3.0])
def test_a_fixed_posture_stays_and_rests(t):
    reference = ConstantPosture([0.3, -0.7]).reference(jnp.asarray(t))
    np.testing.assert_array_equal(reference.q, [0.3, -0.7])
    np.testing.assert_array_equal(reference.dq, [0.0, 0.0])
    np.testing.assert_array_equal(reference.ddq, [0.0, 0.0])
