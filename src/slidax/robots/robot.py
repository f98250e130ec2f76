"""What every robot arm is."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.numerics import matvec, solve_symmetric
from slidax.parts import AbstractPart, Matrix, Scalar, State, Vector


class AbstractRobot(AbstractPart):
    """A rigid arm `M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇) = τ + τ_d`, eq. (10) with joint friction F, and its tip's place.

    A member gives `mass`, `bias`, `friction`, `potential` and `tip`; the rest follows from them.

    - `joint_units`: "rad" for a revolute joint, "m" for a prismatic one; one entry per joint.
    - `joint_names`: what the joints are called in tables, figures and messages.
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
        """The inertia matrix `M(q)`, [n n], kg m², kg m, kg.

        - `q`: positions [n].
        """

    @abstractmethod
    def bias(self, q: Vector, dq: Vector) -> Vector:
        """`C(q,q̇) q̇ + G(q)`, [n], N m or N.

        - `q`, `dq`: positions and velocities [n].
        """

    @abstractmethod
    def friction(self, dq: Vector) -> Vector:
        """The joints' own friction `F(q̇)`, [n], N m or N; 0 for an arm without.

        A law does not count on it: its sign turns with noise. So it is no part of `bias`.

        - `dq`: velocities [n].
        """

    @abstractmethod
    def potential(self, q: Vector) -> Scalar:
        """The potential energy whose gradient is `G(q)`, J.

        - `q`: positions [n].
        """

    @abstractmethod
    def tip(self, q: Vector) -> Float[Array, "3"]:
        """The tip's place in the base frame, [3], m.

        - `q`: positions [n].
        """

    def gravity(self, q: Vector) -> Vector:
        """`G(q)`, [n], N m or N.

        - `q`: positions [n].
        """
        return self.bias(q, jnp.zeros_like(q))

    def coriolis(self, q: Vector, dq: Vector) -> Matrix:
        """`C(q,q̇)` in Christoffel form, for which `Ṁ - 2C` is skew-symmetric, [n n].

        It is half the derivative of the bias along the velocity, since `C(q,q̇) q̇` is a quadratic form in it.

        - `q`, `dq`: positions and velocities [n].
        """
        slope: Matrix = jax.jacfwd(self.bias, argnums=1)(q, dq)
        return 0.5 * slope

    def energy(self, state: State) -> Scalar:
        """Kinetic and potential energy, J.

        - `state`: positions and velocities.
        """
        return 0.5 * jnp.sum(state.dq * matvec(self.mass(state.q), state.dq)) + self.potential(state.q)

    def acceleration(self, state: State, tau: Vector) -> Vector:
        """`q̈ = M(q)⁻¹ (τ - C q̇ - G - F)`, [n].

        - `state`: positions and velocities.
        - `tau`: all generalised forces together [n], N m or N.
        """
        return solve_symmetric(self.mass(state.q), tau - self.bias(state.q, state.dq) - self.friction(state.dq))
