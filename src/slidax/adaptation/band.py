"""Band-pass filter of the adaptation, and the encoder noise that passes it."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.parts import Scalar

LOUDEST = 1e6
"""rad/s²: upper limit of `noise_of`; such noise hides every inertia."""

STAGES = 5
"""Two high-passes and three low-passes of first order."""


def filter_step(
    stages: Float[Array, "5 k n"], signals: Float[Array, "k n"], low: Scalar, high: Scalar, period: Scalar
) -> Float[Array, "5 k n"]:
    """Return the stages of the band-pass after a sample; the last stage is its output.

    Two high-passes of first order at `low` remove slow signals, such as weight that the model does not know. Three
    low-passes at `high` then bound the second difference of rounded positions.

    - `stages`: before the sample, for each signal: two low-passed parts that are subtracted, three low-passes.
    - `signals`: at this sample.
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


def settled_stages(signals: Float[Array, "k n"]) -> Float[Array, "5 k n"]:
    """Return the stages after a long time with constant signals: the output is 0."""
    nothing = jnp.zeros_like(signals)
    return jnp.stack([signals] + [nothing] * (STAGES - 1))


def noise_of(deviation: float, low: float, high: float, period: float) -> float:
    """Return the standard deviation of a measured acceleration in the band, rad/s², for white position noise.

    `σ √(h/π ∫ |D(ω) F(ω)|² dω)` up to `π/h`, with D and F the frequency responses of the second difference and
    the filter.

    - `deviation`: of a measured position, rad; `r/√12` for a resolution r.
    - `low`, `high`: ends of the band [rad/s].
    - `period`: h [s].
    """
    delay = np.exp(-1j * np.linspace(1e-6, math.pi, 4096))
    a, b = -math.expm1(-low * period), -math.expm1(-high * period)
    below, above = (share / (1 - (1 - share) * delay) for share in (a, b))
    # In units of 1/h², so that no period is too short.
    response = (1 - delay) ** 2 * (1 - below) ** 2 * above**3
    size = math.sqrt(float(np.mean(np.abs(response) ** 2)))
    return min(deviation / period * size / period, LOUDEST)
