"""Positions and velocities as they are measured."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._errors import as_array, known, require, require_consistent, require_shape
from slidax._types import PerJoint, Scalar, State, Vector

from .estimator import AbstractEstimator, Estimate


class Measured(AbstractEstimator):
    """`q = q'`, `q̇ = q̇'`, and the push by an α-β filter of what the velocity did beyond the prediction.

    With `r = (q̇' - q̇_predicted)/h`: `w⁺ = w + h d + g (r + push - w - h d)`, `d⁺ = d + b (r + push - w - h d)/h`,
    `push⁺ = w⁺ + ahead h d⁺`. Here w is the unexplained acceleration in the middle of the last period and d its rate;
    push is what it will be when the next torque acts, so that a push that grows evenly is made up for without a lag.
    For sensors with a good velocity.

    - `gain`: g, one number or [n], in [0, 1]; 0 with trend 0 leaves the push as it is.
    - `trend`: b, one number or [n], in [0, 4 - 2 g]; 0 for a filter of first order; `critical` gives the one that is
      critically damped.
    - `ahead`: from the middle of the last measured period to the middle of the one that the torque acts in, in periods.

    Raises DefinitionError if one of them is out of its range.
    """

    gain: PerJoint = eqx.field(converter=as_array, default=0.5)
    trend: PerJoint = eqx.field(converter=as_array, default=0.0)
    ahead: Scalar = eqx.field(converter=as_array, default=0.0)

    def __check_init__(self) -> None:
        require_consistent(self, "gain", "trend")
        require_shape(self, (), "ahead")
        require(self, "gain", (known(self.gain) >= 0) & (known(self.gain) <= 1), "must be in [0, 1]")
        # Beyond it the filter itself is unstable (Jury).
        require(
            self,
            "trend",
            (known(self.trend) >= 0) & (known(self.trend) <= 4.0 - 2.0 * known(self.gain)),
            "must be in [0, 4 - 2 gain]",
        )
        require(self, "ahead", known(self.ahead) >= 0, "must be >= 0 periods")

    @classmethod
    def critical(cls, gain: Any, ahead: Any) -> Measured:
        """With `b = 2 - g - 2 √(1 - g)`: both poles of the filter are `√(1 - g)`.

        - `gain`: g, one number or [n], in [0, 1].
        - `ahead`: in periods.

        Raises DefinitionError if one of them is out of its range.
        """
        gain = as_array(gain)
        return cls(gain, 2.0 - gain - 2.0 * jnp.sqrt(jnp.maximum(1.0 - gain, 0.0)), ahead)

    def init(self, measured: State) -> Vector:
        """The push's rate, d: none.

        - `measured`: the first measurement.
        """
        return jnp.zeros_like(measured.q)

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: Vector
    ) -> tuple[Estimate, Vector]:
        """The measurement, and the push.

        - `measured`: measured positions and velocities.
        - `prior`: the prediction.
        - `elapsed`: time since the last measurement [s], > 0.
        - `missed`: whether samples were missed.
        - `memory`: d, [n].
        """
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
