"""How large the robust torque must be."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, known, require, require_shape
from slidax._types import Scalar, State, Vector
from slidax.numerics import vector_norm


class UncertaintyBound(eqx.Module):
    """`u = (k + b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`, `γ = (m2 - m1)/(m2 + m1)`, eqs. (45), (46).

    It covers a lumped uncertainty bounded by `b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖`, eq. (19).

    - `inertia_min`, `inertia_max`: m1, m2 with `m1 <= ‖M⁻¹(q)‖ <= m2`, eq. (47), 1/(kg m²), 0 < m1 <= m2.
    - `constant`, `position`, `velocity`: b0 [N m], b1 [N m/rad], b2 [N m s²/rad²], >= 0.
    - `margin`: k, N m, > 0.

    Raises DefinitionError if one of them is out of its range.
    """

    inertia_min: Scalar = eqx.field(converter=as_array)
    inertia_max: Scalar = eqx.field(converter=as_array)
    constant: Scalar = eqx.field(converter=as_array)
    position: Scalar = eqx.field(converter=as_array)
    velocity: Scalar = eqx.field(converter=as_array)
    margin: Scalar = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        require_shape(self, (), "inertia_min", "inertia_max", "constant", "position", "velocity", "margin")
        require(self, "inertia_min", known(self.inertia_min) > 0, "must be > 0 (m1, eq. 47)")
        require(
            self,
            "inertia_max",
            known(self.inertia_max) >= known(self.inertia_min),
            f"must be >= `inertia_min` = {self.inertia_min} (m2, eq. 47)",
        )
        for field, symbol in (("constant", "b0"), ("position", "b1"), ("velocity", "b2")):
            require(self, field, known(getattr(self, field)) >= 0, f"must be >= 0 ({symbol}, eq. 19)")
        require(self, "margin", known(self.margin) > 0, "must be > 0 (k, eq. 45)")

    @property
    def gamma(self) -> Scalar:
        """`γ = (m2 - m1)/(m2 + m1)`, eq. (46)."""
        return (self.inertia_max - self.inertia_min) / (self.inertia_max + self.inertia_min)

    def __call__(self, state: State, tau: Vector) -> Scalar:
        """`u`, eq. (45), N m.

        - `state`: positions and velocities.
        - `tau`: `τ0 + τ1` [n], N m or N.
        """
        q_norm = vector_norm(state.q)
        dq_square = jnp.sum(state.dq * state.dq)
        gamma = self.gamma
        known = self.constant + self.position * q_norm + self.velocity * dq_square
        return (self.margin + known + gamma * vector_norm(tau)) * (1.0 / (1.0 - gamma))
