"""Positions and velocities as they are measured."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax._errors import parameter, require, require_consistent
from slidax._types import PerJoint, Scalar, State

from .estimator import AbstractEstimator, Estimate


class Measured(AbstractEstimator):
    """`q = q'`, `q̇ = q̇'`, `push⁺ = push + g (q̇' - q̇_predicted)/h`.

    For sensors with a good velocity: the push is what that velocity did beyond the prediction, through a low-pass.

    - `gain`: g, one number or [n], in [0, 1]; 0 leaves the push as it is.

    Raises DefinitionError if it is out of its range.
    """

    gain: PerJoint = eqx.field(converter=parameter, default=0.5)

    def __check_init__(self) -> None:
        require_consistent(self, "gain")
        require(self, "gain", (self.gain >= 0) & (self.gain <= 1), "must be in [0, 1]")

    def init(self, measured: State) -> tuple[()]:
        """Nothing to keep.

        - `measured`: the first measurement.
        """
        return ()

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: tuple[()]
    ) -> tuple[Estimate, tuple[()]]:
        """The measurement, and the push.

        - `measured`: measured positions and velocities.
        - `prior`: the prediction.
        - `elapsed`: time since the last measurement [s], > 0.
        - `missed`: whether samples were missed.
        - `memory`: empty.
        """
        unexplained = self.gain * ((measured.dq - prior.state.dq) / elapsed)
        return Estimate(state=measured, push=prior.push + jnp.where(missed, 0.0, unexplained)), ()
