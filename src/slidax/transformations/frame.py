"""The envelope for a plan over one horizon."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._types import PerJoint, Vector

from .psi import Sides, psi_and_slope, psi_inverse


class Frame(eqx.Module):
    """Limits of the led error `y = e + c ė` now, and at the end of a plan over one horizon.

    - `now`: radius of the led envelope, `ρ + c ρ̇`, [n], rad or m; 1 without an envelope.
    - `ahead`: its tangent one horizon later, `now + H (ρ̇ + c ρ̈)`, [n], rad or m; 1 without an envelope.
    - `sides`: of the envelope; None without one.
    """

    now: PerJoint
    ahead: PerJoint
    sides: Sides | None

    def place_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`ψ(ε)` and its derivative, [n]: the place in the frame, times `now` or `ahead` in rad or m.

        - `eps`: transformed error [n].
        """
        if self.sides is None:
            return eps, jnp.ones_like(eps)
        return psi_and_slope(eps, self.sides)

    def transformed(self, y: Vector) -> Vector:
        """`ψ⁻¹(y/now)`, [n], with y held inside the frame by a relative 1e-9, so that it is defined for every y.

        - `y`: led error [n], rad or m.
        """
        if self.sides is None:
            return y
        lower, upper = self.sides.lower, self.sides.upper
        inside = 1.0 - 1e-9
        return psi_inverse(jnp.clip(y / self.now, inside * lower, inside * upper), self.sides)
