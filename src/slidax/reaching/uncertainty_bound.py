"""Robust torque that covers the lumped uncertainty."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.numerics import vector_norm
from slidax.parts import Scalar, State, Vector, parameter

from .bound import AbstractBound


class UncertaintyBound(AbstractBound):
    """`u = (k + b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`, `γ = (m2 - m1)/(m2 + m1)`, eqs. (45), (46).

    It covers a lumped uncertainty bounded by `b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖`, eq. (19). An arm's inverse inertia is
    known to be `m1 <= ‖M⁻¹(q)‖ <= m2`, eq. (47).
    """

    title = "Robust torque that covers the lumped uncertainty."

    inverse_inertia_min: Scalar = parameter("m1 <= ‖M⁻¹(q)‖", "1/(kg m²)", "> 0", "(m1, eq. 47)")
    inverse_inertia_max: Scalar = parameter("m2 >= ‖M⁻¹(q)‖", "1/(kg m²)", ">= inverse_inertia_min", "(m2, eq. 47)")
    b0: Scalar = parameter("b0, of all states alike", "N m", ">= 0", "(eq. 19)")
    b1: Scalar = parameter("b1, times ‖q‖", "N m/rad", ">= 0", "(eq. 19)")
    b2: Scalar = parameter("b2, times ‖q̇‖²", "N m s²/rad²", ">= 0", "(eq. 19)")
    margin: Scalar = parameter("k, in excess of the uncertainty", "N m", "> 0", "(k, eq. 45)")

    @property
    def gamma(self) -> Scalar:
        """`γ = (m2 - m1)/(m2 + m1)`, eq. (46)."""
        least, most = self.inverse_inertia_min, self.inverse_inertia_max
        return (most - least) / (most + least)

    def __call__(self, state: State, tau: Vector) -> Scalar:
        """`u`, eq. (45), N m."""
        q_norm = vector_norm(state.q)
        dq_square = jnp.sum(state.dq * state.dq)
        gamma = self.gamma
        known = self.b0 + self.b1 * q_norm + self.b2 * dq_square
        return (self.margin + known + gamma * vector_norm(tau)) * (1.0 / (1.0 - gamma))
