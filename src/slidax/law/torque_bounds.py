"""Bounds of the uncertain torque, which a reaching law must dominate.

The uncertain torque or lumped uncertainty is the effect of model errors and disturbances. The paper is Nonlinear
Dynamics (2022), doi 10.1007/s11071-022-07650-w.
"""

from __future__ import annotations

from abc import abstractmethod

import jax.numpy as jnp

from slidax.core.errors import require, static_value
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.powers import vector_norm
from slidax.core.types import Scalar, State, Vector

MOST_SPREAD = 1e12
"""Largest ratio of the bounds of an inverse inertia; from 1e16 on, γ of the paper's eq. (46) is 1 and u infinite."""


class AbstractBound(AbstractPart):
    """Size u of the robust torque, the paper's eqs. (44), (45): at least the bound of the uncertain torque."""

    @abstractmethod
    def __call__(self, state: State, tau: Vector) -> Scalar:
        """Return u, N m.

        - `state`: positions and velocities.
        - `tau`: the torque without its robust part, `τ0 + τ1`, [n], N m or N.
        """


class FixedBound(AbstractBound):
    """`u = const`: for laws whose user chooses the size of the robust torque."""

    title = "A robust torque of constant size."

    size: Scalar = parameter("u, size of the robust torque", "N m", ">= 0")

    def __call__(self, state: State, tau: Vector) -> Scalar:
        return self.size


class StateBound(AbstractBound):
    """`b0 + b1‖q‖ + b2‖q̇‖²`: the paper's bound (19) of the lumped uncertainty, without the term in ‖τ‖."""

    title = "Bound of the state-dependent uncertainty."

    b0: Scalar = parameter("b0, constant part of the bound", "N m", ">= 0", "(eq. 19)")
    b1: Scalar = parameter("b1, times ‖q‖", "N m/rad", ">= 0", "(eq. 19)")
    b2: Scalar = parameter("b2, times ‖q̇‖²", "N m s²/rad²", ">= 0", "(eq. 19)")

    def __call__(self, state: State, tau: Vector) -> Scalar:
        return self.b0 + self.b1 * vector_norm(state.q) + self.b2 * jnp.sum(state.dq * state.dq)


class UncertaintyBound(AbstractBound):
    """`u = (k + b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`, `γ = (m2 - m1)/(m2 + m1)`, the paper's eqs. (45), (46).

    It covers a lumped uncertainty bounded by `b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖`, eq. (19). An arm's inverse inertia is
    known to be `m1 <= ‖M⁻¹(q)‖ <= m2`, eq. (47). τ0 + τ1 is the law's torque without the robust torque.
    """

    title = "Robust torque that covers the lumped uncertainty."

    inverse_inertia_min: Scalar = parameter("m1 <= ‖M⁻¹(q)‖", "1/(kg m²)", "> 0", "(m1, eq. 47)")
    inverse_inertia_max: Scalar = parameter("m2 >= ‖M⁻¹(q)‖", "1/(kg m²)", ">= inverse_inertia_min", "(m2, eq. 47)")
    b0: Scalar = parameter("b0, constant part of the bound", "N m", ">= 0", "(eq. 19)")
    b1: Scalar = parameter("b1, times ‖q‖", "N m/rad", ">= 0", "(eq. 19)")
    b2: Scalar = parameter("b2, times ‖q̇‖²", "N m s²/rad²", ">= 0", "(eq. 19)")
    margin: Scalar = parameter("k, margin above the bound of the uncertainty", "N m", "> 0", "(k, eq. 45)")

    def __check_init__(self) -> None:
        least, most = static_value(self.inverse_inertia_min), static_value(self.inverse_inertia_max)
        rule = f"must be at most {MOST_SPREAD:g} times `inverse_inertia_min`: u grows with the ratio (paper, eq. 45)"
        require(self, "inverse_inertia_max", (least <= 0.0) | (most <= MOST_SPREAD * least), rule)

    @property
    def gamma(self) -> Scalar:
        """`γ = (m2 - m1)/(m2 + m1)`, the paper's eq. (46)."""
        least, most = self.inverse_inertia_min, self.inverse_inertia_max
        return (most - least) / (most + least)

    def __call__(self, state: State, tau: Vector) -> Scalar:
        """Return `u`, the paper's eq. (45), N m."""
        q_norm = vector_norm(state.q)
        dq_square = jnp.sum(state.dq * state.dq)
        gamma = self.gamma
        known = self.b0 + self.b1 * q_norm + self.b2 * dq_square
        return (self.margin + known + gamma * vector_norm(tau)) * (1.0 / (1.0 - gamma))
