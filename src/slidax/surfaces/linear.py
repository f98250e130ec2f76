"""The classical linear surface."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Vector, parameter

from .surface import AbstractSurface


class Linear(AbstractSurface):
    """`Λ e`: on `s = ė + Λ e = 0` the error decays as `exp(-Λ t)`.

    Source: Slotine and Li, Applied Nonlinear Control, 1991, chapter 7.
    """

    title = "The classical linear surface."

    rate: PerJoint = parameter(
        "diagonal of Λ, how fast the error decays on the surface",
        "1/s",
        "> 0",
        "so that the error decays (Slotine and Li, 1991)",
    )

    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`Λ e`, and `Λ`, both [n]."""
        return self.rate * eps, self.rate * jnp.ones_like(eps)

    def reach(self, pull: Vector) -> Vector:
        """`pull/Λ`, [n]."""
        return pull / self.rate
