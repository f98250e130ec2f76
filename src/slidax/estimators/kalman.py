"""A Kalman filter with fixed gains for each joint."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from slidax.parts import DefinitionError, Scalar, State, Vector, as_array, is_traced, parameter

from .estimator import AbstractEstimator, Estimate, reseated
from .steady_gains import steady_gains

TORQUE_DENSITY = 0.05
"""Of the drift of a disturbance torque unless another is asked for, (N m/s)² s: in one second it drifts by .2 N m."""

FASTEST_PACE = 1.0
"""d, bandwidth times period, of the fastest filter by default: with a faster one a delayed loop tolerates little error
of the inertia (docs/learning.md)."""


class Kalman(AbstractEstimator):
    """`q = q_predicted + L1 r`, `q̇ = q̇_predicted + L2 r`, `push⁺ = push + L3 r`, with `r = q' - q_predicted`.

    Measured velocities are not used. After a gap that is longer than the filter's memory, 2/L2, it begins anew.
    """

    gains: Float[Array, "3 ..."] = parameter(
        "L1, L2, L3, three numbers or three per joint; `steady` and `of_arm` find them", "1, 1/s or 1/s²", ">= 0"
    )

    inertia: Vector | None = parameter(
        "for which the gains are, where they follow what is learnt of it", "kg m² or kg", "> 0", default=None
    )
    pace: Vector | None = parameter(
        "d, the filter's bandwidth there times the period, (density h⁵/variance)^(1/6)", "", "> 0", default=None
    )

    def __check_init__(self) -> None:
        shape = self.gains.shape
        if len(shape) not in (1, 2) or shape[0] != 3:
            raise DefinitionError(f"`Kalman.gains` must be three numbers or three per joint; got shape {list(shape)}")

    @classmethod
    def steady(cls, *, density: Any, variance: Any, period: Any) -> Kalman:
        """The steady-state filter for a push that drifts as a random walk.

        - `density`: spectral density of d(push)/dt, one number or [n], (rad/s³)² s or (m/s³)² s, > 0. The standard
          deviation of what the push drifts by in a time t is `√(density t)`.
        - `variance`: of a measured position, one number or [n], rad² or m², > 0; `r²/12` for a resolution r.
        - `period`: time between two samples [s], > 0.

        Raises DefinitionError if one of them is out of its range.
        """
        return cls(steady_gains(density, variance, period))

    @classmethod
    def of_arm(
        cls, mass: Any, *, variance: Any, period: Any, torque_density: Any = TORQUE_DENSITY, fastest: Any = None
    ) -> Kalman:
        """The steady filter for a disturbance torque with the same drift on all joints, each with its own inertia.

        The filter stores only the gains, so that a sample costs three products. They can be batched and differentiated
        with respect to every argument: construct the filter inside `vmap` or `grad`.

        - `mass`: inertia matrix of the nominal arm where it works [n n], kg m², kg m, kg.
        - `variance`: of a measured position, one number or [n], rad² or m², > 0; `r²/12` for a resolution r.
        - `period`: time between two samples [s], > 0.
        - `torque_density`: spectral density of dτ_d/dt, one number or [n], (N m/s)² s, > 0. docs/loop-rate.md shows
          its effect.
        - `fastest`: largest d, bandwidth times period; a joint whose filter would be faster gets the one of coarser
          encoders. None: no limit.

        Raises DefinitionError if one of them is out of its range.
        """
        torque_density = as_array(torque_density)
        if not is_traced(torque_density) and not np.all((np.asarray(torque_density) > 0) & np.isfinite(torque_density)):
            raise DefinitionError(
                f"`torque_density` of a Kalman filter must be > 0 (N m/s)² s and finite; got {torque_density}"
            )
        inertia, density, pace = _paces(*(as_array(value) for value in (mass, torque_density, variance, period)))
        if fastest is not None:
            variance = jnp.maximum(as_array(variance), density * as_array(period) ** 5 / as_array(fastest) ** 6)
            pace = jnp.minimum(pace, fastest)
        return cls(steady_gains(density, variance, period), inertia, pace)

    def for_inertia(self, inertia: Vector) -> Kalman:
        """The gains for joints of another inertia.

        The density of the push is that of the torque over Î², and the pace d of a filter is the sixth root of its
        density: it becomes `d (I/Î)^(1/3)`. The gains change as those of `paced` do: by `(I/Î)^(1/3)` and its square
        and cube for a slow filter, and hardly for a fast one.
        """
        if self.inertia is None or self.pace is None:
            return self
        ratio = jnp.exp(jnp.log(self.inertia / inertia) * (1.0 / 3.0))
        gains = self.gains * (paced(self.pace * ratio) / paced(self.pace))
        return Kalman(gains, inertia, self.pace * ratio)

    def init(self, measured: State) -> tuple[()]:
        return ()

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: tuple[()]
    ) -> tuple[Estimate, tuple[()]]:
        """The prediction, corrected in proportion to the residual."""
        residual = measured.q - prior.state.q
        usual = Estimate(
            state=State(
                q=prior.state.q + self.gains[0] * residual,
                dq=prior.state.dq + self.gains[1] * residual,
            ),
            push=prior.push + self.gains[2] * residual,
        )
        # A gap that is shorter than what the filter remembers changes little of what it knows.
        forgotten = missed & (self.gains[1] * elapsed > 2.0)
        return reseated(measured, prior, elapsed, forgotten, usual), ()


def paced(pace: Vector) -> Float[Array, "3 n"]:
    """`L1, L2 h, L3 h²` of the filter whose errors have the poles `e^{-d}` and `e^{-d (1 ± i √3)/2}`, [3 n].

    These are the poles of a slow steady filter (Butterworth's). Its characteristic polynomial is
    `z³ + (L1 + L2 h + L3 h²/2 - 3) z² + (3 - 2 L1 - L2 h + L3 h²/2) z + L1 - 1`.

    - `pace`: d [n].
    """
    real, half = jnp.exp(-pace), jnp.exp(-0.5 * pace)
    turn = (0.5 * math.sqrt(3.0)) * pace
    pair = 2.0 * half * jnp.cos(turn)
    first = 1.0 - real * real
    # (1 - z1)(1 - z2)(1 - z3), without a difference of numbers that are nearly equal.
    away = jnp.square(jnp.expm1(-0.5 * pace)) + 4.0 * half * jnp.square(jnp.sin(0.5 * turn))
    third = -jnp.expm1(-pace) * away
    return jnp.stack([first, 3.0 - first - 0.5 * third - real - pair, third])


# As one program: JAX would compile each of its operations alone.
@jax.jit
def _paces(mass: Any, torque_density: Any, variance: Any, period: Any) -> tuple[Any, Any, Any]:
    """The diagonal of the inertia, the density of the push, and d."""
    inertia = jnp.diagonal(mass)
    density = torque_density / (inertia * inertia)
    return inertia, density, jnp.clip(density / variance * period**5, 1e-18, 1e18) ** (1.0 / 6.0)
