"""A tolerance band that a run is judged by, whatever its scheme promises."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax._types import Scalar, Vector
from slidax.transformations import PrescribedPerformance
from slidax.transformations.psi import Sides


class Watched(eqx.Module):
    """Margin to a tolerance band `b ρ(t) < e < b̄ ρ(t)`, eq. (12), with the sides of (13) from the true first error.

    - `sides`: b and b̄ [n].
    - `outside`: how many of the samples had a joint at or outside its bounds, [].
    - `margin`: min over time of the distance to the nearer bound, divided by the band's width [n]; below 0 outside.
    """

    sides: Sides
    outside: Int[Array, ""]
    margin: Vector

    @staticmethod
    def begin(tolerance: PrescribedPerformance, e: Vector) -> Watched:
        """Before the first sample.

        - `tolerance`: ρ and ϑ.
        - `e`: error at t = 0 [n], rad or m.
        """
        sides = tolerance.init(jnp.zeros(()), e)
        return Watched(sides=sides, outside=jnp.zeros((), int), margin=jnp.full(e.shape, jnp.inf))

    def add(self, tolerance: PrescribedPerformance, t: Scalar, e: Vector, running: Bool[Array, ""]) -> Watched:
        """The same with one more sample.

        - `tolerance`: ρ and ϑ.
        - `t`: time [s].
        - `e`: error [n], rad or m.
        - `running`: whether the run is not over yet.
        """
        bounds = tolerance.envelope(t, self.sides)
        known = running & jnp.all(jnp.isfinite(e))
        inside = jnp.all((bounds.lower < e) & (e < bounds.upper))
        nearer = jnp.minimum(e - bounds.lower, bounds.upper - e) / (bounds.upper - bounds.lower)
        return Watched(
            sides=self.sides,
            outside=self.outside + (known & ~inside).astype(int),
            margin=jnp.where(known, jnp.minimum(self.margin, nearer), self.margin),
        )
