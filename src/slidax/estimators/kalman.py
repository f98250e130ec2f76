"""A Kalman filter with fixed gains, for each joint by itself."""

from __future__ import annotations

from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float

from slidax._errors import DefinitionError, parameter, require
from slidax._types import Scalar, State

from .estimator import AbstractEstimator, Estimate, reseated
from .steady_gains import steady_gains


class Kalman(AbstractEstimator):
    """`q = q_predicted + L1 r`, `q̇ = q̇_predicted + L2 r`, `push⁺ = push + L3 r`, with `r = q' - q_predicted`.

    Measured velocities are not used.

    - `gains`: L1 [1], L2 [1/s], L3 [1/s²], three numbers [3] or three per joint [3 n], >= 0; `steady` finds them.

    Raises DefinitionError if they are of another shape or out of their range.
    """

    gains: Float[Array, "..."] = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        shape = self.gains.shape
        if len(shape) not in (1, 2) or shape[0] != 3:
            raise DefinitionError(f"`Kalman.gains` must be three numbers or three per joint; got shape {list(shape)}")
        require(self, "gains", self.gains >= 0, "must be >= 0")

    @classmethod
    def steady(cls, *, density: Any, variance: Any, period: Any) -> Kalman:
        """The gains that the filter comes to for a push that drifts as a random walk.

        - `density`: spectral density of d(push)/dt, one number or [n], (rad/s³)² s or (m/s³)² s, > 0. The standard
          deviation of what the push drifts by in a time t is `√(density t)`.
        - `variance`: of a measured position, one number or [n], rad² or m², > 0; `r²/12` for a resolution r.
        - `period`: time between two samples [s], > 0.

        Raises DefinitionError if one of them is out of its range.
        """
        return cls(steady_gains(density, variance, period))

    def init(self, measured: State) -> tuple[()]:
        """Nothing to keep.

        - `measured`: the first measurement.
        """
        return ()

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: tuple[()]
    ) -> tuple[Estimate, tuple[()]]:
        """The prediction, corrected in proportion to the residual.

        - `measured`: measured positions; velocities are not used.
        - `prior`: the prediction.
        - `elapsed`: time since the last measurement [s], > 0.
        - `missed`: whether samples were missed.
        - `memory`: empty.
        """
        residual = measured.q - prior.state.q
        usual = Estimate(
            state=State(
                q=prior.state.q + self.gains[0] * residual,
                dq=prior.state.dq + self.gains[1] * residual,
            ),
            push=prior.push + self.gains[2] * residual,
        )
        return reseated(measured, prior, elapsed, missed, usual), ()
