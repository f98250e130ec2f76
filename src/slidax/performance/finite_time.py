"""A performance function that settles at a time which depends on where it starts."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import known, parameter, require, require_consistent
from slidax._types import PerJoint, Scalar
from slidax.numerics import power

from .performance import AbstractPerformance, require_narrowing


class FiniteTime(AbstractPerformance):
    """The solution of `ρ̇ = -c (ρ - ρ∞)^κ`: `ρ(t) = ((ρ0 - ρ∞)^(1-κ) - (1-κ) c t)^(1/(1-κ)) + ρ∞`, then `ρ∞`.

    It settles at `T = (ρ0 - ρ∞)^(1-κ) / ((1-κ) c)`, which grows with ρ0; that is what the paper holds against the
    finite-time functions it cites as [43]. Reconstructed: the paper does not print that function; this one is usual.

    - `initial`: ρ0, one number or [n], rad or m; greater than |e(0)|.
    - `final`: ρ∞, one number or [n], rad or m; 0 < ρ∞ < ρ0.
    - `rate`: c, one number or [n], rad^(1-κ)/s, > 0.
    - `exponent`: κ, one number or [n], in (1/2, 1), so that the second derivative is continuous at T.

    Raises DefinitionError if one of them is out of its range.
    """

    initial: PerJoint = eqx.field(converter=parameter)
    final: PerJoint = eqx.field(converter=parameter)
    rate: PerJoint = eqx.field(converter=parameter)
    exponent: PerJoint = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        require_consistent(self, "initial", "final", "rate", "exponent")
        require_narrowing(self)
        require(self, "rate", known(self.rate) > 0, "must be > 0, so that the envelope narrows (Definition 4)")
        require(
            self,
            "exponent",
            (known(self.exponent) > 0.5) & (known(self.exponent) < 1),
            "must be in (1/2, 1), so that the second derivative is continuous where the function settles",
        )

    @property
    def deadline(self) -> PerJoint:
        """`T`, when the function settles, [n], s."""
        a = 1.0 - self.exponent
        return power(self.initial - self.final, a) / (a * self.rate)

    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m.

        - `t`: time [s], >= 0.
        """
        a = 1.0 - self.exponent
        left = jnp.maximum(power(self.initial - self.final, a) - a * self.rate * t, 0.0)
        return power(left, 1.0 / a) + self.final
