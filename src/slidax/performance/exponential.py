"""The classical performance function, which settles only in the limit."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import known, parameter, require, require_consistent
from slidax._types import PerJoint, Scalar

from .performance import AbstractPerformance, require_narrowing


class Exponential(AbstractPerformance):
    """`ρ(t) = (ρ0 - ρ∞) exp(-l t) + ρ∞`. Source: Bechlioulis and Rovithakis, 2008, the paper's [28].

    - `initial`: ρ0, one number or [n], rad or m; greater than |e(0)|.
    - `final`: ρ∞, one number or [n], rad or m; 0 < ρ∞ < ρ0.
    - `rate`: l, one number or [n], 1/s, > 0.

    Raises DefinitionError if one of them is out of its range.
    """

    initial: PerJoint = eqx.field(converter=parameter)
    final: PerJoint = eqx.field(converter=parameter)
    rate: PerJoint = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        require_consistent(self, "initial", "final", "rate")
        require_narrowing(self)
        require(self, "rate", known(self.rate) > 0, "must be > 0 1/s, so that the envelope narrows (Definition 4)")

    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m.

        - `t`: time [s], >= 0.
        """
        return (self.initial - self.final) * jnp.exp(-self.rate * t) + self.final
