"""Any arm of rigid links: a tree of revolute and prismatic joints."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax._errors import DefinitionError, require_shape
from slidax.parts import Matrix, Scalar, Vector, parameter, parameters_of, piece

from .joint_limits import JointLimits
from .payload import Payload
from .rigid_body import PAIRS, Axes, Bodies, JointFrames, axes, bias_forces, frames, from_the_base, inertia_matrix
from .robot import AbstractRobot


class Articulated(AbstractRobot):
    """A tree of rigid links, `M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇) = τ + τ_d`, with a payload at its tip.

    Each joint turns about, or slides along, the z axis of its frame; `rotations` and `translations` give that frame in
    its parent's frame at position 0. M comes from composite rigid bodies, with the rotors' armature on its diagonal,
    and the bias from recursive Newton-Euler (Featherstone, 2008). Friction is `F = f_c tanh(q̇/v_s) + f_v q̇` with
    `coulomb`, `smoothing` and `viscous`.

    `slidax.robots.panda()` and the other built-in arms, `from_urdf`, `from_mjcf` and `assemble` make it. Every number
    is a leaf, so that a batch can vary it; `Mismatch` makes the true arm from a nominal one.
    """

    rotations: Float[Array, "n 3 3"] = parameter("each joint's axes in its parent's frame, as columns")
    translations: Float[Array, "n 3"] = parameter("each joint's place in its parent's frame", "m")
    masses: Vector = parameter("masses of the links", "kg", ">= 0")
    centers: Float[Array, "n 3"] = parameter("centres of mass, in the joint's frame", "m")
    inertias: Float[Array, "n 3 3"] = parameter("inertias about the centres of mass, in the joint's axes", "kg m²")
    armature: Vector = parameter("inertia of the rotors, seen from the joints", "kg m² or kg", ">= 0")
    viscous: Vector = parameter("viscous friction f_v", "N m s/rad or N s/m", ">= 0")
    coulomb: Vector = parameter("Coulomb friction f_c", "N m or N", ">= 0")
    smoothing: Scalar = parameter("v_s, the velocity within which Coulomb friction turns", "rad/s or m/s", "> 0")
    gravity_vector: Float[Array, "3"] = parameter("acceleration of gravity in the base frame", "m/s²")
    tip_rotation: Float[Array, "3 3"] = parameter("the tip's axes in the frame of the joint that carries it")
    tip_translation: Float[Array, "3"] = parameter("the tip's place there", "m")
    payload: Payload = piece("what the tip carries")
    limits: JointLimits = piece("what the joints can do, by their data sheet; nothing here keeps them")
    name: str = piece("of the arm, for messages and pictures", static=True)
    joint_names: tuple[str, ...] = piece("of the joints", static=True)
    link_names: tuple[str, ...] = piece("of the links that they move", static=True)
    parents: tuple[int, ...] = piece(
        "number of the joint before each, -1 for the base; always less than its own", static=True
    )
    tip_joint: int = piece("number of the joint that carries the tip", static=True)
    joint_units: tuple[str, ...] = piece('"rad" or "m" for each joint', static=True)

    def __check_init__(self) -> None:
        n = self.joints
        for declared in parameters_of(type(self)):
            if not declared.piece and declared.shape != "one number":
                size = tuple(n if entry == "n" else int(entry) for entry in declared.shape.strip("[]").split())
                require_shape(self, size, declared.name)
        for field in ("joint_names", "link_names", "parents"):
            entries = getattr(self, field)
            if len(entries) != n:
                raise DefinitionError(f"`{field}` of {self.name} must be {n}, as many as `joint_units`; got {entries}")
        if any(not -1 <= parent < i for i, parent in enumerate(self.parents)):
            raise DefinitionError(f"`parents` of {self.name} must each be before their joint; got {self.parents}")

    def mass(self, q: Vector) -> Matrix:
        return _inertia(*_links(self, self._frames(q)), self.armature, self.parents)

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return _bias(*_links(self, self._frames(q)), dq, self.gravity_vector, self.parents)

    def friction(self, dq: Vector) -> Vector:
        """Return `F(q̇) = f_c tanh(q̇/v_s) + f_v q̇`, [n], N m or N."""
        return self.coulomb * jnp.tanh(dq / self.smoothing) + self.viscous * dq

    def potential(self, q: Vector) -> Scalar:
        moment = jnp.sum(from_the_base(self._bodies(), self._frames(q)).moment, axis=1)
        return -jnp.sum(self.gravity_vector * moment)

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.tip_frame(q)[1]

    def tip_frame(self, q: Vector) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Return the tip's axes, as columns, and its position in the base frame, [3 3] and [3], m."""
        at = self._frames(q)
        rotation, place = at.rotation[..., self.tip_joint], at.place[:, self.tip_joint]
        turned = jnp.sum(rotation[:, :, None] * self.tip_rotation[None], axis=1)
        return turned, place + jnp.sum(rotation * self.tip_translation[None], axis=1)

    def frames(self, q: Vector) -> tuple[Float[Array, "n 3 3"], Float[Array, "n 3"]]:
        """Return each joint's axes, as columns, and its position in the base frame, [n 3 3] and [n 3], m."""
        at = self._frames(q)
        return jnp.moveaxis(at.rotation, -1, 0), at.place.T

    @property
    def _revolute(self) -> tuple[bool, ...]:
        return tuple(unit == "rad" for unit in self.joint_units)

    def _frames(self, q: Vector) -> JointFrames:
        return _frames(self.rotations, self.translations, q, self.parents, self._revolute)

    def _bodies(self) -> Bodies:
        """The links about their joints' origins; the payload is part of the link that carries the tip."""
        links = _about_the_origin(self.masses, self.centers, self.inertias)
        r, load = self.tip_rotation, self.payload
        center = self.tip_translation + jnp.sum(r * load.center[None], axis=1)
        turned = jnp.sum(r[:, :, None] * load.inertia[None], axis=1)
        turned = jnp.sum(turned[:, None, :] * r[None], axis=2)
        carried = _about_the_origin(load.mass[None], center[None], turned[None])
        at_tip = np.arange(self.joints) == self.tip_joint
        return Bodies(*(link + jnp.where(at_tip, extra, 0.0) for link, extra in zip(links, carried, strict=True)))


# A law calls these several times at each sample: jit's cache saves tracing them anew, and in exported C each stays a
# function. Common results of one posture are computed once.
@functools.partial(jax.jit, static_argnames=("parents", "revolute"))
def _frames(
    rotations: Float[Array, "n 3 3"],
    translations: Float[Array, "n 3"],
    q: Vector,
    parents: tuple[int, ...],
    revolute: tuple[bool, ...],
) -> JointFrames:
    return frames(rotations, translations, parents, revolute, q)


@jax.jit
def _links(arm: Articulated, at: JointFrames) -> tuple[Bodies, Axes]:
    return from_the_base(arm._bodies(), at), axes(at, arm._revolute)


@functools.partial(jax.jit, static_argnames="parents")
def _inertia(bodies: Bodies, moved: Axes, armature: Vector, parents: tuple[int, ...]) -> Matrix:
    matrix = inertia_matrix(bodies, moved, parents)
    return matrix + jnp.where(np.eye(len(parents), dtype=bool), armature, 0.0)


@functools.partial(jax.jit, static_argnames="parents")
def _bias(bodies: Bodies, moved: Axes, dq: Vector, gravity: Float[Array, "3"], parents: tuple[int, ...]) -> Vector:
    return bias_forces(bodies, moved, parents, dq, gravity)


def _about_the_origin(
    masses: Float[Array, " n"], centers: Float[Array, "n 3"], inertias: Float[Array, "n 3 3"]
) -> Bodies:
    square = jnp.sum(centers * centers, axis=1)
    entries = []
    for i, j in PAIRS:
        shift = (square if i == j else 0.0) - centers[:, i] * centers[:, j]
        entries.append(inertias[:, i, j] + masses * shift)
    return Bodies(mass=masses, moment=(masses[:, None] * centers).T, inertia=jnp.stack(entries))
