"""The envelope at the law's samples, and the premises of the closed-form rule there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.transformations import PrescribedPerformance, Sides

from ..each import Floats
from .padded import of_rows


@dataclass(frozen=True)
class Narrowing:
    """Radii at times a period apart, as the law computes them.

    - `times`: when torques start [N], s.
    - `radius`, `rate`, `curvature`: ρ, ρ̇ and ρ̈ [N n].
    - `now`: N, not below a tenth of ρ [N n]; `ahead`: A, likewise [N n].
    - `lower`, `upper`: b and b̄ [n].
    - `lead`, `horizon`, `period`: c, H and h [s].
    """

    times: Floats
    radius: Floats
    rate: Floats
    curvature: Floats
    now: Floats
    ahead: Floats
    lower: Floats
    upper: Floats
    lead: float
    horizon: float
    period: float

    @classmethod
    def of(
        cls, drawn: PrescribedPerformance, sides: Sides, *, period: float, horizon: float, times: Floats, most: int = 0
    ) -> Narrowing:
        """The envelope at given times.

        - `sides`: of the envelope, as the start decides them.
        - `period`, `horizon`: h and H [s].
        - `times`: when torques start [N], s.
        - `most`: largest number of times of all calls that share the compiled program.
        """
        lead = horizon - 0.5 * period
        radius, rate, curvature, now, ahead = of_rows(_sampled, times, most, drawn, sides, lead, horizon)
        lower, upper = np.asarray(sides.lower), np.asarray(sides.upper)
        return cls(np.asarray(times), radius, rate, curvature, now, ahead, lower, upper, lead, horizon, period)

    @property
    def slim(self) -> NDArray[np.bool_]:
        """True where N or A is at its lower limit, so that it is not the led envelope [N n]."""
        now = self.radius + self.lead * self.rate
        ahead = now + self.horizon * (self.rate + self.lead * self.curvature)
        # The law's own sums are rounded otherwise than these.
        rounding = 1e-12 * self.radius
        return (now < self.now - rounding) | (ahead < self.ahead - rounding)

    @property
    def outgrown(self) -> Floats:
        """Excess of the tangent to N over N, `N_k + r (A_k - N_k) - N_{k+1}`, where N is not convex [N-1 n].

        Includes the loss of the step to the deadline, some `h c ρ̈`; the rule's proof needs zero.
        """
        r = self.period / self.horizon
        tangent = self.now[:-1] + r * (self.ahead[:-1] - self.now[:-1])
        return np.maximum(tangent - self.now[1:], 0.0)

    @property
    def sagging(self) -> Floats:
        """`h (ρ̇_k + ρ̇_{k+1})/2 - (ρ_{k+1} - ρ_k)`, where ρ̇ is not concave: the loss of the mean of y and e [N-1 n]."""
        mean = 0.5 * self.period * (self.rate[:-1] + self.rate[1:])
        return np.maximum(mean - np.diff(self.radius, axis=0), 0.0)

    @property
    def unruly(self) -> NDArray[np.bool_]:
        """True for joints without a proof of the closed form [n].

        There a radius is slim, or more than a millionth of the final radius is lost.
        """
        lost = np.sum(self.outgrown + self.sagging, axis=0)
        return np.any(self.slim, axis=0) | (lost > 1e-6 * self.radius[-1])


@eqx.filter_jit
def _sampled(drawn: PrescribedPerformance, sides: Sides, lead: Any, horizon: Any, times: Any) -> Any:
    """ρ, ρ̇, ρ̈, N and A at each time."""

    def at(t: Any) -> Any:
        frame = drawn.frame(t, jnp.asarray(lead), jnp.asarray(horizon), sides)
        moved = drawn.performance.radius_rate_curvature(t)
        return (*(jnp.broadcast_to(value, sides.lower.shape) for value in moved), frame.now, frame.ahead)

    return jax.vmap(at)(jnp.asarray(times))
