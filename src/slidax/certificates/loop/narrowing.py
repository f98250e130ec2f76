"""The envelope as the plans of a law see it along time, and which premises of the closed-form rule hold there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.transformations import PrescribedPerformance, Sides

from .padded import of_rows

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Narrowing:
    """The radii at some times, a period apart, as the law computes them.

    - `times`: when torques set in [N], s.
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
        """What the law of this envelope sees.

        - `drawn`: the envelope.
        - `sides`: of it, as the start decides them.
        - `period`, `horizon`: h and H [s].
        - `times`: when torques set in [N], s.
        - `most`: times that other calls may have, so that all share one compiled program.
        """
        lead = horizon - 0.5 * period
        radius, rate, curvature, now, ahead = of_rows(_seen, times, most, drawn, sides, lead, horizon)
        lower, upper = np.asarray(sides.lower), np.asarray(sides.upper)
        return cls(np.asarray(times), radius, rate, curvature, now, ahead, lower, upper, lead, horizon, period)

    @property
    def slim(self) -> NDArray[np.bool_]:
        """Where N or A is the least that the code allows, so that it is no longer the led envelope [N n]."""
        now = self.radius + self.lead * self.rate
        ahead = now + self.horizon * (self.rate + self.lead * self.curvature)
        # The law's own sums are rounded otherwise than these.
        rounding = 1e-12 * self.radius
        return (now < self.now - rounding) | (ahead < self.ahead - rounding)

    @property
    def outgrown(self) -> Floats:
        """By how much the tangent to N ends above it, `N_k + r (A_k - N_k) - N_{k+1}`, where N is not convex [N-1 n].

        With it what the step to the deadline loses, some `h c ρ̈`; zero where the rule's proof needs nothing else.
        """
        r = self.period / self.horizon
        tangent = self.now[:-1] + r * (self.ahead[:-1] - self.now[:-1])
        return np.maximum(tangent - self.now[1:], 0.0)

    @property
    def sagging(self) -> Floats:
        """`h (ρ̇_k + ρ̇_{k+1})/2 - (ρ_{k+1} - ρ_k)`, where ρ̇ is not concave: what the mean of y and e loses [N-1 n]."""
        mean = 0.5 * self.period * (self.rate[:-1] + self.rate[1:])
        return np.maximum(mean - np.diff(self.radius, axis=0), 0.0)

    @property
    def unruly(self) -> NDArray[np.bool_]:
        """For which joints the closed form is not proved [n].

        Where a radius is slim, or more than a millionth of the final radius is lost.
        """
        lost = np.sum(self.outgrown + self.sagging, axis=0)
        return np.any(self.slim, axis=0) | (lost > 1e-6 * self.radius[-1])


@eqx.filter_jit
def _seen(drawn: PrescribedPerformance, sides: Sides, lead: Any, horizon: Any, times: Any) -> Any:
    """ρ, ρ̇, ρ̈, N and A at each time."""

    def at(t: Any) -> Any:
        frame = drawn.frame(t, jnp.asarray(lead), jnp.asarray(horizon), sides)
        moved = drawn.performance.radius_rate_curvature(t)
        return (*(jnp.broadcast_to(one, sides.lower.shape) for one in moved), frame.now, frame.ahead)

    return jax.vmap(at)(jnp.asarray(times))
