"""Bound of the state-dependent uncertainty."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.numerics import vector_norm
from slidax.parts import Scalar, State, Vector, parameter

from .bound import AbstractBound


class StateBound(AbstractBound):
    """`b0 + b1‖q‖ + b2‖q̇‖²`: the bound (19) of the lumped uncertainty, without the torque's share."""

    title = "Bound of the state-dependent uncertainty."

    b0: Scalar = parameter("b0, of all states alike", "N m", ">= 0", "(eq. 19)")
    b1: Scalar = parameter("b1, times ‖q‖", "N m/rad", ">= 0", "(eq. 19)")
    b2: Scalar = parameter("b2, times ‖q̇‖²", "N m s²/rad²", ">= 0", "(eq. 19)")

    def __call__(self, state: State, tau: Vector) -> Scalar:
        return self.b0 + self.b1 * vector_norm(state.q) + self.b2 * jnp.sum(state.dq * state.dq)
