"""A Kalman filter that follows what is learnt of the inertia."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.law import Kalman

DENSITY, PERIOD = 0.02, 1e-3


def of(inertia, resolution):
    return Kalman.of_arm(np.diag([inertia]), variance=resolution**2 / 12, period=PERIOD, torque_density=DENSITY)


# The finest is what a filter beside an adaptation takes encoders to be.
@pytest.mark.parametrize(("resolution", "off"), [(1e-4, 1e-5), (1e-5, 1e-4), (2e-6, 1e-2)])
@pytest.mark.parametrize("inertia", [0.02, 0.05, 0.3, 1.0])
def test_its_gains_are_those_of_the_filter_for_the_new_inertia(resolution, off, inertia):
    followed = of(0.1, resolution).for_inertia(jnp.array([inertia]))
    np.testing.assert_allclose(followed.gains, of(inertia, resolution).gains, rtol=off)
    np.testing.assert_allclose(followed.pace, of(inertia, resolution).pace, rtol=1e-12)


def test_a_filter_whose_inertia_is_not_known_stays_as_it_is():
    filter_ = Kalman.steady(density=1.0, variance=1e-11, period=PERIOD)
    assert filter_.for_inertia(jnp.array([3.0])) is filter_
