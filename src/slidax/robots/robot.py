"""Base class of all arms."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.numerics import matvec, solve_symmetric
from slidax.parts import AbstractPart, Matrix, Scalar, State, Vector


class AbstractRobot(AbstractPart):
    """A rigid arm `M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇) = τ + τ_d`, eq. (10) with joint friction F.

    A subclass defines `mass`, `bias`, `friction`, `potential` and `tip`.

    - `joint_units`: "rad" for a revolute joint, "m" for a prismatic one.
    - `joint_names`: names for tables, figures and messages.
    """

    joint_units: eqx.AbstractVar[tuple[str, ...]]
    joint_names: eqx.AbstractVar[tuple[str, ...]]

    @property
    def joints(self) -> int:
        """The number of joints."""
        return len(self.joint_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each joint's torque: "N m" for a revolute joint, "N" for a prismatic one."""
        return tuple("N m" if unit == "rad" else "N" for unit in self.joint_units)

    @abstractmethod
    def mass(self, q: Vector) -> Matrix:
        """Return the inertia matrix `M(q)`, [n n], kg m², kg m, kg."""

    @abstractmethod
    def bias(self, q: Vector, dq: Vector) -> Vector:
        """Return `C(q,q̇) q̇ + G(q)`, [n], N m or N."""

    @abstractmethod
    def friction(self, dq: Vector) -> Vector:
        """Return the joint friction `F(q̇)`, [n], N m or N; 0 for an arm without friction.

        `bias` does not contain it, because control laws do not compensate it: its sign changes with noise.
        """

    @abstractmethod
    def potential(self, q: Vector) -> Scalar:
        """Return the potential energy whose gradient is `G(q)`, J."""

    @abstractmethod
    def tip(self, q: Vector) -> Float[Array, "3"]:
        """Return the tip's position in the base frame, [3], m."""

    def gravity(self, q: Vector) -> Vector:
        """Return `G(q)`, [n], N m or N."""
        return self.bias(q, jnp.zeros_like(q))

    def coriolis(self, q: Vector, dq: Vector) -> Matrix:
        """Return `C(q,q̇)` in Christoffel form, for which `Ṁ - 2C` is skew-symmetric, [n n].

        C is half the derivative of the bias by the velocity, since `C(q,q̇) q̇` is a quadratic form in the velocity.
        """
        slope: Matrix = jax.jacfwd(self.bias, argnums=1)(q, dq)
        return 0.5 * slope

    def energy(self, state: State) -> Scalar:
        """Return kinetic plus potential energy, J."""
        return 0.5 * jnp.sum(state.dq * matvec(self.mass(state.q), state.dq)) + self.potential(state.q)

    def acceleration(self, state: State, tau: Vector) -> Vector:
        """Return `q̈ = M(q)⁻¹ (τ - C q̇ - G - F)`, [n].

        - `tau`: sum of all generalised forces [n], N m or N.
        """
        return solve_symmetric(self.mass(state.q), tau - self.bias(state.q, state.dq) - self.friction(state.dq))
