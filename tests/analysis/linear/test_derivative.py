"""The derivative of a sample is that of the sample that is simulated, by differences with a step for each number."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slidax import scenarios
from slidax.analysis.linearise import operating_point
from slidax.analysis.period_map import period_map
from slidax.analysis.sampled_system import connected_states


def off_by(changes: dict[str, Any], at: float) -> float:
    """How far derivatives are from differences of the simulated sample, as a part of the largest in their column.

    Differences are extrapolated to a step of nothing. Each column has the step at which they agree most: rounding wants
    a long one where a number does little, and powers near zero a short one.
    """
    loop, carry, _ = operating_point(scenarios.load("example-4.1-1khz", changes), at)
    one = period_map(loop, carry)
    derivative = one.derivative()
    m = one.x.size
    kept = connected_states(derivative[:m, :m], derivative[:m, m:], derivative[m:, :m])
    assert len(kept) > 8
    place = np.ix_(*(np.concatenate([kept, np.arange(m, size)]) for size in derivative.shape))
    size = np.abs(derivative[place]).max(axis=0)
    # A velocity that nobody measures, and the like, does nothing, and must do so in both.
    size = np.where(size > 0.0, size, 1.0)
    best = np.full(size.shape, np.inf)
    for power in np.arange(1.0, 8.6, 0.5):
        step = np.full(derivative.shape[1], 10.0**-power)
        extrapolated = (4 * one.differences(0.5 * step) - one.differences(step)) / 3
        off = (np.abs(derivative - extrapolated)[place] / size).max(axis=0)
        best = np.fmin(best, off)
    return float(best.max())


@pytest.mark.parametrize(
    ("changes", "at", "close"),
    [
        pytest.param({}, 1.0, 1e-9, marks=pytest.mark.full),
        # Where s is next to zero, its power bends within what a step must have.
        pytest.param({}, 5.0, 1e-8, marks=pytest.mark.full),
        ({"scheme.name": "computed_torque"}, 1.0, 1e-9),
        pytest.param({"scheme.name": "computed_torque"}, 5.0, 1e-9, marks=pytest.mark.full),
    ],
)
def test_the_derivative_is_that_of_the_simulated_sample(changes: dict[str, Any], at: float, close: float) -> None:
    assert off_by(changes, at) < close
