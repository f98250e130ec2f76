"""Adjusted: a nominal arm with other inertias of its links and a body at its tip, both estimated by an adaptive law."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.core.parameter import parameter, piece
from slidax.core.tracing import barrier
from slidax.core.types import Matrix, Scalar, Vector

from .arm import AbstractRobot
from .articulated import (
    PAIRS,
    Articulated,
    Bodies,
    JointAxes,
    about_base_origin,
    ancestry,
    bias_forces,
    cross,
    inertia_matrix,
    joint_axes,
    momentum,
    motion_of_links,
)

PAYLOAD = 10
"""Number of a rigid body's parameters: mass, mass times centre, inertia about the origin (xx, yy, zz, xy, xz, yz)."""


class Adjusted(AbstractRobot):
    """A nominal arm whose link i has `1 + factors_i` times its mass and inertia, with a body added at the tip.

    The nominal arm's payload belongs to its link. With factors 0 and a body of mass 0 and inertia 0 it is the nominal
    arm. M(q) and the bias C q̇ + G change linearly with `factors` and `body`. Friction, rotor inertia and tip frame are
    the nominal arm's.
    """

    joint_units: tuple[str, ...] = piece('"rad" or "m" for each joint', static=True)
    joint_names: tuple[str, ...] = piece("names of the joints", static=True)
    nominal: Articulated = piece("the arm without these changes")
    factors: Vector = parameter("relative change of each link's mass and inertia")
    body: Float[Array, "10"] = parameter(
        "added body in the frame of the joint that carries the tip: mass, mass times centre, inertia about the origin "
        "(xx, yy, zz, xy, xz, yz)",
        "kg, kg m, kg m²",
    )

    @classmethod
    def of(cls, nominal: Articulated, factors: Vector, body: Float[Array, "10"]) -> Adjusted:
        """Return the nominal arm with changed links and an added body.

        - `nominal`: the arm without changes, n joints.
        - `factors`: relative change of each link's mass and inertia [n].
        - `body`: ten inertial parameters of the added body, as in the field `body`.
        """
        return cls(
            joint_units=nominal.joint_units,
            joint_names=nominal.joint_names,
            nominal=nominal,
            factors=factors,
            body=body,
        )

    def mass(self, q: Vector) -> Matrix:
        return _mass(self, *_placed(self, q))

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return _bias(self, *_placed(self, q), dq)

    def friction(self, dq: Vector) -> Vector:
        return self.nominal.friction(dq)

    def potential(self, q: Vector) -> Scalar:
        bodies, _ = _placed(self, q)
        return -jnp.sum(self.nominal.gravity_vector * jnp.sum(bodies.moment, axis=1))

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.nominal.tip(q)

    def bodies(self) -> Bodies:
        """Return each link's mass properties about its joint's origin, with the changes."""
        arm, scale, body = self.nominal, 1.0 + self.factors, self.body
        links = arm.bodies()
        at_tip = np.arange(arm.joints) == arm.tip_joint
        return Bodies(
            mass=links.mass * scale + jnp.where(at_tip, body[0], 0.0),
            moment=links.moment * scale + jnp.where(at_tip, body[1:4, None], 0.0),
            inertia=links.inertia * scale + jnp.where(at_tip, body[4:, None], 0.0),
        )


# With jit, each is traced once and becomes a function in exported C, as in `Articulated`.
@jax.jit
def _placed(arm: Adjusted, q: Vector) -> tuple[Bodies, JointAxes]:
    at = arm.nominal.joint_frames(q)
    return about_base_origin(arm.bodies(), at), joint_axes(at, arm.nominal.revolute)


@jax.jit
def _mass(arm: Adjusted, bodies: Bodies, moved: JointAxes) -> Matrix:
    matrix = inertia_matrix(bodies, moved, arm.nominal.parents)
    return matrix + jnp.where(np.eye(arm.joints, dtype=bool), arm.nominal.armature, 0.0)


@jax.jit
def _bias(arm: Adjusted, bodies: Bodies, moved: JointAxes, dq: Vector) -> Vector:
    return bias_forces(bodies, moved, arm.nominal.parents, dq, arm.nominal.gravity_vector)


class Regressor(NamedTuple):
    """Derivatives of an arm's torques and inertia with respect to 10 + n parameters.

    First come the 10 inertial parameters of a body added at the tip, then n factors; factor i scales the mass and
    inertia of link i.

    - `torque`: derivative of each joint's torque [n 10+n].
    - `inertia`: derivative of each diagonal entry of M [n 10+n].

    Rotor inertia and friction do not depend on these parameters.
    """

    torque: Float[Array, "n p"]
    inertia: Float[Array, "n p"]


# With jit, it is traced once and becomes a function in exported C.
@jax.jit
def inertial_regressor(arm: Articulated, q: Vector, dq: Vector, ddq: Vector) -> Regressor:
    """Return the derivatives of an arm's inverse dynamics and inertia (Atkeson, An and Hollerbach 1986).

    - `arm`: n joints. The link columns of `torque` add up to the arm's inverse dynamics without rotors and friction.
    - `q`, `dq`, `ddq`: positions, velocities and accelerations at which the torques are computed [n].
    """
    at = arm.joint_frames(q)
    axes, links = joint_axes(at, arm.revolute), about_base_origin(arm.bodies(), at)
    motion = barrier(motion_of_links(axes, arm.parents, dq, ddq, arm.gravity_vector))
    v, w, av, aw = motion
    force, torque = momentum(links, av, aw)
    linear, angular = barrier(momentum(links, v, w))
    force, torque = force + cross(w, linear), torque + cross(w, angular) + cross(v, linear)
    ancestors = ancestry(arm.parents)
    of_links = jnp.where(ancestors, _power(axes, force, torque), 0.0)
    stacked = jnp.concatenate([links.mass[None], links.moment, links.inertia])
    squares = jnp.sum(_squares(axes)[:, :, None] * stacked[:, None, :], axis=0)

    # The body at the tip, in the frame of the joint that carries it.
    tip = arm.tip_joint
    rotation, place = at.rotation[..., tip], at.position[:, tip]
    tip_axes = JointAxes(*barrier(_from(rotation, place, axes.angular, axes.linear)))
    moves = ancestors[:, tip]
    omega, velocity = (part[:, 0] for part in _from(rotation, place, w[:, tip, None], v[:, tip, None]))
    alpha, acceleration = (part[:, 0] for part in _from(rotation, place, aw[:, tip, None], av[:, tip, None]))
    forces, torques = barrier(_body_columns(omega, alpha, acceleration + cross(omega, velocity)))
    of_body = jnp.where(moves[:, None], _power(tip_axes, forces, torques), 0.0)
    own = jnp.where(moves[:, None], _squares(tip_axes).T, 0.0)
    return Regressor(
        torque=jnp.concatenate([of_body, of_links], axis=1),
        inertia=jnp.concatenate([own, jnp.where(ancestors, squares, 0.0)], axis=1),
    )


def _power(axes: JointAxes, force: Float[Array, "3 k"], torque: Float[Array, "3 k"]) -> Float[Array, "n k"]:
    """Return the torque of each joint for each of k wrenches at the frame's origin."""
    return jnp.sum(axes.angular[:, :, None] * torque[:, None] + axes.linear[:, :, None] * force[:, None], axis=0)


def _squares(axes: JointAxes) -> Float[Array, "10 n"]:
    """Derivatives of twice a body's kinetic energy by its 10 parameters, at a unit velocity of each joint."""
    w, v = axes
    moment = 2.0 * cross(v, w)
    products = [2.0 * w[0] * w[1], 2.0 * w[0] * w[2], 2.0 * w[1] * w[2]]
    return jnp.concatenate([jnp.sum(v * v, axis=0)[None], moment, w * w, jnp.stack(products)])


def _from(
    rotation: Float[Array, "3 3"], place: Float[Array, "3"], angular: Float[Array, "3 k"], linear: Float[Array, "3 k"]
) -> tuple[Float[Array, "3 k"], Float[Array, "3 k"]]:
    """Transform spatial vectors at the base's origin to a frame with axes `rotation` and origin `place`."""
    moved = linear + cross(angular, place[:, None])
    turned = (jnp.sum(rotation[:, :, None] * part[:, None], axis=0) for part in (angular, moved))
    return next(turned), next(turned)


def _body_columns(
    w: Float[Array, "3"], alpha: Float[Array, "3"], a: Float[Array, "3"]
) -> tuple[Float[Array, "3 10"], Float[Array, "3 10"]]:
    """Return force F and torque N at the origin of a body's frame for each of its parameters.

    `F = m a + α x h + ω x (ω x h)`, `N = h x a + I α + ω x I ω`, with h the mass times the centre.

    - `w`, `alpha`: angular velocity and acceleration.
    - `a`: acceleration of the origin.
    """
    zero = jnp.zeros_like(w)
    units = list(jnp.eye(3))
    turns = [cross(alpha, unit) + cross(w, cross(w, unit)) for unit in units]
    arms = [cross(unit, a) for unit in units]
    moments = []
    for i, j in PAIRS:
        momentum_rate = _symmetric_image(i, j, alpha)
        moments.append(momentum_rate + cross(w, _symmetric_image(i, j, w)))
    return jnp.stack([a, *turns, *[zero] * 6], axis=1), jnp.stack([zero, *arms, *moments], axis=1)


def _symmetric_image(i: int, j: int, x: Float[Array, "3"]) -> Float[Array, "3"]:
    """Product of the symmetric matrix with ones at (i, j) and (j, i), and a vector."""
    entries = [jnp.zeros(())] * 3
    entries[i], entries[j] = x[j], x[i]
    return jnp.stack(entries)
