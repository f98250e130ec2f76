"""The nominal arm with estimated rotor inertias."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.parts import Matrix, PerJoint, Scalar, Vector, parameter, piece
from slidax.robots import AbstractRobot

LEAST_SHARE = 0.01
"""Least share of a nominal diagonal entry that remains, so that M̂ stays positive definite."""


class Believed(AbstractRobot):
    """`M̂ = S (M0 + diag(max(J, 0) - J0)) S`, with bias, friction and tip of the nominal arm.

    S is 1 where `J >= 0`; else it scales the joint's row and column so that the diagonal entry becomes
    `M0_ii + J - J0`. The links' part `M0 - diag(J0)` is positive semidefinite, so that M̂ is positive definite where
    every J is positive, and a congruence does not change that.
    """

    joint_units: tuple[str, ...] = piece('"rad" or "m" for each joint', static=True)
    joint_names: tuple[str, ...] = piece("of the joints", static=True)
    nominal: AbstractRobot = piece("the robot as the law knows it")
    rotor: Vector = parameter("J, inertia on the diagonal beside that of the links", "kg m² or kg")
    counted: PerJoint = parameter("J0, rotor inertia that the nominal arm has", "kg m² or kg", ">= 0")

    @classmethod
    def of(cls, nominal: AbstractRobot, rotor: Vector, counted: PerJoint) -> Believed:
        """Return a nominal arm with other rotors J instead of J0, kg m² or kg."""
        return cls(
            joint_units=nominal.joint_units,
            joint_names=nominal.joint_names,
            nominal=nominal,
            rotor=rotor,
            counted=counted,
        )

    def mass(self, q: Vector) -> Matrix:
        return with_rotors(self.nominal.mass(q), self.rotor, self.counted)

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return self.nominal.bias(q, dq)

    def friction(self, dq: Vector) -> Vector:
        return self.nominal.friction(dq)

    def potential(self, q: Vector) -> Scalar:
        return self.nominal.potential(q)

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.nominal.tip(q)


# Traced once, and one function in exported C, as the functions of `Articulated`.
@jax.jit
def with_rotors(mass: Matrix, rotor: Vector, counted: PerJoint) -> Matrix:
    """Return `S (M0 + diag(max(J, 0) - J0)) S` as in `Believed`, [n n].

    - `mass`, `rotor`, `counted`: M0 [n n], J [n], J0.
    """
    diagonal = jnp.eye(mass.shape[0], dtype=bool)
    heavier = mass + jnp.where(diagonal, (jnp.maximum(rotor, 0.0) - counted)[:, None], 0.0)
    entry = jnp.diagonal(heavier)
    scale = jnp.sqrt(jnp.maximum((entry + jnp.minimum(rotor, 0.0)) / entry, LEAST_SHARE))
    return heavier * scale[:, None] * scale[None, :]
