"""The paper's performance function: settled at a time drawn in advance."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import known, parameter, require, require_consistent
from slidax._types import PerJoint, Scalar
from slidax.numerics import power

from .performance import AbstractPerformance, require_narrowing


class FixedTime(AbstractPerformance):
    """`ρ(t) = (ρ0 - ρ∞)(1 - t/T)^σ + ρ∞` for `t < T`, then `ρ∞`, eq. (20).

    - `initial`: ρ0, one number or [n], rad or m; greater than |e(0)|.
    - `final`: ρ∞, one number or [n], rad or m; 0 < ρ∞ < ρ0.
    - `deadline`: T, one number or [n], s, > 0.
    - `exponent`: σ, one number or [n], > 2.

    Raises DefinitionError if one of them is out of its range.
    """

    initial: PerJoint = eqx.field(converter=parameter)
    final: PerJoint = eqx.field(converter=parameter)
    deadline: PerJoint = eqx.field(converter=parameter)
    exponent: PerJoint = eqx.field(converter=parameter)

    def __check_init__(self) -> None:
        require_consistent(self, "initial", "final", "deadline", "exponent")
        require_narrowing(self)
        require(self, "deadline", known(self.deadline) > 0, "must be > 0 s (eq. 20)")
        smooth = "must be > 2, so that the second derivative is continuous at T (eq. 20)"
        require(self, "exponent", known(self.exponent) > 2, smooth)

    def radius(self, t: Scalar) -> PerJoint:
        """`ρ(t)`, [n], rad or m.

        - `t`: time [s], >= 0.
        """
        left = jnp.maximum(1.0 - t / self.deadline, 0.0)
        return (self.initial - self.final) * power(left, self.exponent) + self.final
