"""Measured positions and velocities, and an α-β filter of the disturbance."""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.parts import PerJoint, Scalar, State, Vector, as_array, parameter

from .estimator import AbstractEstimator, Estimate

WITH_TREND, WITHOUT_TREND = 1.0 / 6.0, 0.3
"""Largest default gains g for a delay of up to one period, and for longer ones. With the default horizon the linear
loop is then stable for believed inertias of 1/3 to 3/2 of the true one."""


class Measured(AbstractEstimator):
    """`q = q'`, `q̇ = q̇'`, and the push by an α-β filter of what the velocity did beyond the prediction.

    With `r = (q̇' - q̇_predicted)/h`: `w⁺ = w + h d + g (r + push - w - h d)`, `d⁺ = d + b (r + push - w - h d)/h`,
    `push⁺ = w⁺ + ahead h d⁺`. Here w is the unexplained acceleration in the middle of the last period and d its rate;
    push is what it will be when the next torque acts, so that a push that grows evenly is compensated without a lag.
    For sensors with a good velocity.
    """

    title = "Measured positions and velocities, and an α-β filter of the disturbance."

    reads_velocity: ClassVar[bool] = True

    gain: PerJoint = parameter("g, of the push; 0 with trend 0 leaves it as it is", "", "[0, 1]", default=WITHOUT_TREND)
    trend: PerJoint = parameter(
        "b, of its rate; 0 for a filter of first order; `critical` gives the one that is critically damped",
        "",
        "[0, 4 - 2 * gain]",
        "so that the filter itself is stable (Jury)",
        default=0.0,
    )
    ahead: Scalar = parameter(
        "from the middle of the last measured period to the middle of the one that the torque acts in",
        "periods",
        ">= 0",
        default=0.0,
    )

    @classmethod
    def critical(cls, gain: Any, ahead: Any) -> Measured:
        """With `b = 2 - g - 2 √(1 - g)`: both poles of the filter are `√(1 - g)`.

        - `gain`: g, one number or [n], in [0, 1].
        - `ahead`: in periods.

        Raises DefinitionError if one of them is out of its range.
        """
        gain = as_array(gain)
        return cls(gain, 2.0 - gain - 2.0 * jnp.sqrt(jnp.maximum(1.0 - gain, 0.0)), ahead)

    @classmethod
    def tolerant(cls, delay: float, most: Any = 1.0) -> Measured:
        """The default for a joint whose inertia or drive torque may be far from the nominal one.

        Extrapolating the push by its trend costs tolerance, the more the longer the delay. Up to one period the filter
        is `critical` with g = 1/6; beyond, it has no trend, and g = 0.3. docs/learning.md has the inertia ratios that
        the loop tolerates.

        - `delay`: age of a measurement when its torque sets in [periods].
        - `most`: g is not larger than this.
        """
        if delay > 1.0:
            return cls(jnp.minimum(WITHOUT_TREND, most))
        return cls.critical(jnp.minimum(WITH_TREND, most), delay + 1.0)

    def init(self, measured: State) -> Vector:
        """The push's rate d, zero at the start."""
        return jnp.zeros_like(measured.q)

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: Vector
    ) -> tuple[Estimate, Vector]:
        """The measurement, and the push."""
        unexplained = (measured.dq - prior.state.dq) / elapsed
        grown = (1.0 - self.ahead) * elapsed * memory
        # w + h d, what the filter expected of this period, is `push + (1 - ahead) h d`.
        surprise = unexplained - grown
        rate = memory + self.trend * surprise / elapsed
        push = prior.push + grown + self.gain * surprise + self.ahead * elapsed * rate
        return (
            Estimate(state=measured, push=jnp.where(missed, prior.push, push)),
            jnp.where(missed, memory, rate),
        )
