"""Base class of all arms, joint limits, and the payload at the tip."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.core.errors import DefinitionError, as_array, is_traced, require, require_shape, static_value
from slidax.core.linear_algebra import matvec, solve_symmetric
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.types import Matrix, Scalar, State, Vector


class AbstractRobot(AbstractPart):
    """A rigid arm `M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇) = τ + τ_d`, eq. (10) of the paper with joint friction F.

    q are the positions of the n joints, τ the torques of the drives, τ_d those of a disturbance. A subclass defines
    `mass`, `bias`, `friction`, `potential` and `tip`.

    - `joint_units`: "rad" for a revolute joint, "m" for a prismatic one.
    - `joint_names`: names for tables, figures and messages.
    """

    joint_units: eqx.AbstractVar[tuple[str, ...]]
    joint_names: eqx.AbstractVar[tuple[str, ...]]

    @property
    def joints(self) -> int:
        """The number of joints, n."""
        return len(self.joint_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each joint's torque: "N m" for a revolute joint, "N" for a prismatic one."""
        return tuple("N m" if unit == "rad" else "N" for unit in self.joint_units)

    @abstractmethod
    def mass(self, q: Vector) -> Matrix:
        """Return the inertia matrix `M(q)`, [n n], kg m², or with prismatic joints also kg m and kg."""

    @abstractmethod
    def bias(self, q: Vector, dq: Vector) -> Vector:
        """Return `C(q,q̇) q̇ + G(q)`, [n], N m or N."""

    @abstractmethod
    def friction(self, dq: Vector) -> Vector:
        """Return the joint friction `F(q̇)`, [n], N m or N; 0 for an arm without friction.

        `bias` excludes friction, since its sign changes with the noise of a measured velocity.
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

        `C(q,q̇) q̇` is quadratic in q̇, so C is half the derivative of the bias with respect to q̇.
        """
        slope: Matrix = jax.jacfwd(self.bias, argnums=1)(q, dq)
        return 0.5 * slope

    def energy(self, state: State) -> Scalar:
        """Return kinetic plus potential energy, J."""
        return 0.5 * jnp.sum(state.dq * matvec(self.mass(state.q), state.dq)) + self.potential(state.q)

    def acceleration(self, state: State, tau: Vector) -> Vector:
        """Return `q̈ = M(q)⁻¹ (τ - C q̇ - G - F)`, [n], rad/s² or m/s².

        - `tau`: sum of the torques of drives and disturbance, without friction [n], N m or N.
        """
        return solve_symmetric(self.mass(state.q), tau - self.bias(state.q, state.dq) - self.friction(state.dq))


class JointLimits(AbstractPart):
    """Limits of each joint [n]; infinite for a missing or unknown limit."""

    lower: Vector = parameter("least positions", "rad or m", "[-inf, inf)")
    upper: Vector = parameter("largest positions", "rad or m", "(lower, inf]")
    velocity: Vector = parameter("largest speeds", "rad/s or m/s", "(0, inf]")
    torque: Vector = parameter("largest torques", "N m or N", "(0, inf]")
    torque_rate: Vector = parameter("fastest changes of torque", "N m/s or N/s", "(0, inf]")

    def __check_init__(self) -> None:
        require_shape(self, (self.lower.size,), "upper", "velocity", "torque", "torque_rate")


def _moments(value: Any) -> Array:
    """Return an inertia matrix [3 3]; one number means equal moments about all axes, as for a ball."""
    moments = as_array(value)
    if moments.shape not in ((), (3, 3)):
        raise DefinitionError(f"`Payload.inertia` must be one number or 3 x 3; got {list(moments.shape)}")
    return moments if moments.shape else moments * jnp.eye(3)


class Payload(AbstractPart):
    """A rigid body held by the tip, in the tip's frame; a mass of 0 means no payload."""

    mass: Scalar = parameter("mass", "kg", ">= 0", default=0.0)
    center: Float[Array, "3"] = parameter("centre of mass", "m", default=(0.0, 0.0, 0.0))
    inertia: Float[Array, "3 3"] = parameter(
        "inertia about the centre of mass, or one number for a ball", "kg m²", default=0.0, converter=_moments
    )

    def __check_init__(self) -> None:
        inertia = static_value(self.inertia)
        if is_traced(inertia) or not np.isfinite(inertia).all():
            return
        scale = np.abs(inertia).max()
        require(self, "inertia", np.allclose(inertia, inertia.T, rtol=0, atol=1e-12 * scale), "must be symmetric")
        require(self, "inertia", np.linalg.eigvalsh(inertia).min() >= -1e-12 * scale, "must have moments >= 0")
        require(
            self,
            "mass",
            scale == 0 or static_value(self.mass) > 0,
            "must be > 0 kg where there is inertia",
            finite=False,
        )

    def times(self, share: Scalar) -> Payload:
        """Return the body with mass and inertia times a factor, such as 0 for no payload."""
        return Payload(mass=share * self.mass, center=self.center, inertia=share * self.inertia)

    def joined(self, other: Payload) -> Payload:
        """Return a single payload equal to this and another one together; both are in the same frame."""
        mass = self.mass + other.mass
        share = other.mass / jnp.where(mass > 0, mass, 1.0)
        between = other.center - self.center
        square = jnp.sum(between * between) * jnp.eye(3) - between[:, None] * between[None]
        return Payload(
            mass=mass,
            center=self.center + share * between,
            inertia=self.inertia + other.inertia + self.mass * share * square,
        )
