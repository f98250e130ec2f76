"""The band in which is learnt, and how much noise of an encoder is in it."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.parts import Scalar

STAGES = 5
"""Of the filter: two high-passes and three low-passes of first order."""


def through(
    stages: Float[Array, "5 k n"], signals: Float[Array, "k n"], low: Scalar, high: Scalar, period: Scalar
) -> Float[Array, "5 k n"]:
    """The stages of the band-pass after a sample; the last of them is what it lets through.

    Two high-passes of first order at `low`, whose slopes take out what changes slowly, such as weight that the model
    does not know, and then three low-passes at `high`, so that a second difference of rounded positions is bounded.

    - `stages`: what the stages had, of each signal: two low-passed parts that are taken away, three low-passes.
    - `signals`: of this sample.
    - `low`, `high`: ends of the band [rad/s].
    - `period`: h [s].
    """
    a, b = -jnp.expm1(-low * period), -jnp.expm1(-high * period)
    slow = stages[0] + a * (signals - stages[0])
    once = signals - slow
    slower = stages[1] + a * (once - stages[1])
    first = stages[2] + b * (once - slower - stages[2])
    second = stages[3] + b * (first - stages[3])
    return jnp.stack([slow, slower, first, second, stages[4] + b * (second - stages[4])])


def started(signals: Float[Array, "k n"]) -> Float[Array, "5 k n"]:
    """The stages of a band-pass that has seen these signals for long: nothing comes through.

    - `signals`: of the first sample.
    """
    nothing = jnp.zeros_like(signals)
    return jnp.stack([signals] + [nothing] * (STAGES - 1))


def noise_of(deviation: float, low: float, high: float, period: float) -> float:
    """Standard deviation of a measured acceleration in the band, rad/s², from white noise of the position.

    With the frequency response of the second difference and the filter, `σ √(h/π ∫ |D(ω) F(ω)|² dω)` to `π/h`.

    - `deviation`: of a measured position, rad; `r/√12` for a resolution r.
    - `low`, `high`: ends of the band [rad/s].
    - `period`: h [s].
    """
    delay = np.exp(-1j * np.linspace(1e-6, math.pi, 4096))
    a, b = -math.expm1(-low * period), -math.expm1(-high * period)
    below, above = (share / (1 - (1 - share) * delay) for share in (a, b))
    response = ((1 - delay) / period) ** 2 * (1 - below) ** 2 * above**3
    return deviation * math.sqrt(float(np.mean(np.abs(response) ** 2)))
