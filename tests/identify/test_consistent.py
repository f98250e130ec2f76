"""The nearest parameters that bodies can have."""

import numpy as np
import pytest

from slidax.identify.regression import consistent_parameters, pseudo_inertia
from slidax.identify.regressor import parameters_of_body

GOOD = parameters_of_body(1.0, np.array([0.1, 0.0, 0.05]), np.diag([2e-3, 3e-3, 4e-3]))
INSIDE = np.array([1.0, 0, 0, 0, 0.1, 0.1, 0.1, 0, 0, 0])
NONE = np.zeros(10, bool)


def information(seed):
    half = np.random.default_rng(seed).normal(size=(10, 10))
    return half @ half.T * 100.0 + np.eye(10)


def test_consistent_parameters_stay_to_the_bit():
    np.testing.assert_array_equal(consistent_parameters(GOOD, information(0), (0,), NONE, INSIDE), GOOD)


@pytest.mark.parametrize("seed", range(4))
def test_inconsistent_parameters_move_to_the_best_point_of_the_boundary(seed):
    weigh, bad = information(seed), GOOD.copy()
    bad[4] = -0.05
    found = consistent_parameters(bad, weigh, (0,), NONE, INSIDE)
    off = found - bad
    least = np.linalg.eigvalsh(pseudo_inertia(found))
    assert least[0] > 0 and least[0] < 1e-3
    # No consistent body near it fits better.
    cost = off @ weigh @ off
    rng = np.random.default_rng(seed)
    for size in np.repeat([1e-1, 1e-2, 1e-3], 100):
        other = found + size * rng.normal(size=10)
        if np.linalg.eigvalsh(pseudo_inertia(other))[0] > 0:
            assert (other - bad) @ weigh @ (other - bad) > cost - 1e-4 * (1.0 + cost)


def test_numbers_that_cannot_be_negative_go_to_zero_and_the_others_follow():
    weigh = np.array([[2.0, 1.0], [1.0, 2.0]]) * 1e4
    found = consistent_parameters(np.array([-1.0, 3.0]), weigh, (), np.array([True, False]), np.array([1.0, 1.0]))
    assert 0 < found[0] < 1e-3
    # With the first on its bound, the best of the second is where its slope is 0: 3 - 1/2.
    assert found[1] == pytest.approx(2.5, abs=1e-3)
