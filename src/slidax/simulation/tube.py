"""Tolerance band that judges a run, independent of the scheme's envelope."""

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
    - `outside`: number of samples with a joint at or outside its bounds, [].
    - `margin`: min over time of the distance to the nearer bound, divided by the band's width [n]; below 0 outside.
    """

    sides: Sides
    outside: Int[Array, ""]
    margin: Vector

    @staticmethod
    def begin(tolerance: PrescribedPerformance, e: Vector) -> Watched:
        """Before the first sample, for an error e at t = 0 [n], rad or m."""
        sides = tolerance.init(jnp.zeros(()), e)
        return Watched(sides=sides, outside=jnp.zeros((), int), margin=jnp.full(e.shape, jnp.inf))

    def add(self, tolerance: PrescribedPerformance, t: Scalar, e: Vector, running: Bool[Array, ""]) -> Watched:
        """Add a sample with error e [n], rad or m, at t [s]."""
        bounds = tolerance.envelope(t, self.sides)
        known = running & jnp.all(jnp.isfinite(e))
        inside = jnp.all((bounds.lower < e) & (e < bounds.upper))
        nearer = jnp.minimum(e - bounds.lower, bounds.upper - e) / (bounds.upper - bounds.lower)
        return Watched(
            sides=self.sides,
            outside=self.outside + (known & ~inside).astype(int),
            margin=jnp.where(known, jnp.minimum(self.margin, nearer), self.margin),
        )
