"""Time laws: the curve parameter s as a function of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .series import Array

RAMP = 1.5
"""Peak acceleration of a smooth ramp of velocity, times its duration, over the velocity."""


class TimeLaw(NamedTuple):
    """Piecewise polynomials s(t) from 0 to 1, from rest to rest, with a continuous second derivative.

    - `times`: ends of the pieces, from 0 on [k], s.
    - `coefficients`: in powers of the time since the piece began, lowest first [k-1 powers].
    """

    times: Array
    coefficients: Array

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return s with its first and second derivative at times [m], s."""
        piece = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.coefficients) - 1)
        x = t - self.times[piece]
        values = []
        coefficients = self.coefficients
        for order in range(3):
            value = np.zeros_like(x)
            for column in coefficients.T[::-1]:
                value = value * x + column[piece]
            values.append(value)
            coefficients = coefficients[:, 1:] * np.arange(1, coefficients.shape[1]) if order < 2 else coefficients
        s, rate, curvature = values
        return np.clip(s, 0.0, 1.0), rate, curvature

    def stretched(self, factor: float) -> TimeLaw:
        """Return the law with all times multiplied by a factor."""
        powers = np.arange(self.coefficients.shape[1])
        return TimeLaw(self.times * factor, self.coefficients / factor**powers)


def smoothest(duration: float) -> TimeLaw:
    """Return `s = 10 z³ - 15 z⁴ + 6 z⁵`, `z = t/T`: minimum jerk from rest to rest."""
    return TimeLaw(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0, 10.0, -15.0, 6.0]])).stretched(duration)


def linear(duration: float) -> TimeLaw:
    """Return `s = t/T`, for a curve that itself starts and ends at rest."""
    return TimeLaw(np.array([0.0, duration]), np.array([[0.0, 1.0 / duration]]))


def cruising(length: float, speed: float, acceleration: float) -> TimeLaw:
    """Return a smooth ramp up to a speed, constant speed, and the same ramp down.

    On the ramp the speed is `v (3 z² - 2 z³)`. A curve that is too short does not reach `speed`.

    - `length`: of the curve, m or rad; speed and acceleration in its unit.
    """
    speed = min(speed, float(np.sqrt(length * acceleration / RAMP)))
    ramp = RAMP * speed / acceleration
    even = max(length / speed - ramp, 0.0)
    v, r = speed / length, ramp
    up = [0.0, 0.0, 0.0, v / r**2, -v / (2 * r**3)]
    start = v * r / 2
    down = [start + v * even, v, 0.0, -v / r**2, v / (2 * r**3)]
    if even <= 1e-9 * r:
        return TimeLaw(np.array([0.0, r, 2 * r]), np.array([up, [start, *down[1:]]]))
    return TimeLaw(np.array([0.0, r, r + even, 2 * r + even]), np.array([up, [start, v, 0.0, 0.0, 0.0], down]))
