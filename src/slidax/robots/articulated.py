"""Any arm of rigid links: a tree of revolute and prismatic joints."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax._errors import DefinitionError, as_array, is_traced, known
from slidax._types import Matrix, Scalar, Vector

from .joint_limits import JointLimits
from .payload import Payload
from .rigid_body import PAIRS, Bodies, Frames, axes, bias_forces, frames, from_the_base, inertia_matrix
from .robot import AbstractRobot


class Articulated(AbstractRobot):
    """A tree of rigid links, `M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇) = τ + τ_d`, with what it carries at its tip.

    Each joint turns about, or slides along, the z axis of its own frame; the frame stands in that of the joint before
    it at `rotations`, `translations` while its position is 0. M is by composite rigid bodies with the rotors' armature
    on its diagonal, the bias by recursive Newton-Euler (Featherstone, 2008), and
    `F = f_c tanh(q̇/v_s) + f_v q̇` with `coulomb`, `smoothing` and `viscous`.

    Made by `slidax.robots.panda()` and its like, `from_urdf`, `from_mjcf`, or `assemble` of joints. Every number is a
    leaf, so that a batch can vary it; `Mismatch` makes the true arm of a nominal one.

    - `rotations`, `translations`: each joint's frame in its parent's [n 3 3], [n 3], m.
    - `masses`: of the links [n], kg.
    - `centers`: of mass, in the joint's frame [n 3], m.
    - `inertias`: about the centres of mass, in the joint's axes [n 3 3], kg m².
    - `armature`: inertia of the rotors, seen from the joints [n], kg m² or kg.
    - `viscous`, `coulomb`: friction [n], N m s/rad or N s/m, N m or N.
    - `smoothing`: v_s, the velocity within which Coulomb friction turns, rad/s or m/s.
    - `gravity_vector`: its acceleration [3], m/s².
    - `tip_rotation`, `tip_translation`: the tip's frame in that of the joint that carries it [3 3], [3], m.
    - `payload`: what the tip carries.
    - `limits`: of the joints, by their data sheet; nothing here keeps them.
    - `name`, `joint_names`, `link_names`: for messages and pictures.
    - `parents`: number of the joint before each, -1 for the base; always less than its own.
    - `tip_joint`: number of the joint that carries the tip.
    - `joint_units`: "rad" or "m" for each joint.

    Raises DefinitionError if shapes do not fit, or a number is out of its range.
    """

    rotations: Float[Array, "n 3 3"] = eqx.field(converter=as_array)
    translations: Float[Array, "n 3"] = eqx.field(converter=as_array)
    masses: Float[Array, " n"] = eqx.field(converter=as_array)
    centers: Float[Array, "n 3"] = eqx.field(converter=as_array)
    inertias: Float[Array, "n 3 3"] = eqx.field(converter=as_array)
    armature: Vector = eqx.field(converter=as_array)
    viscous: Vector = eqx.field(converter=as_array)
    coulomb: Vector = eqx.field(converter=as_array)
    smoothing: Scalar = eqx.field(converter=as_array)
    gravity_vector: Float[Array, "3"] = eqx.field(converter=as_array)
    tip_rotation: Float[Array, "3 3"] = eqx.field(converter=as_array)
    tip_translation: Float[Array, "3"] = eqx.field(converter=as_array)
    payload: Payload
    limits: JointLimits
    name: str = eqx.field(static=True)
    joint_names: tuple[str, ...] = eqx.field(static=True)
    link_names: tuple[str, ...] = eqx.field(static=True)
    parents: tuple[int, ...] = eqx.field(static=True)
    tip_joint: int = eqx.field(static=True)
    joint_units: tuple[str, ...] = eqx.field(static=True)

    def __check_init__(self) -> None:
        n = len(self.joint_units)
        shapes = {
            **{"rotations": (n, 3, 3), "translations": (n, 3), "masses": (n,), "centers": (n, 3)},
            **{"inertias": (n, 3, 3), "armature": (n,), "viscous": (n,), "coulomb": (n,), "smoothing": ()},
            **{"gravity_vector": (3,), "tip_rotation": (3, 3), "tip_translation": (3,)},
        }
        for field, shape in shapes.items():
            if np.shape(getattr(self, field)) != shape:
                given = list(np.shape(getattr(self, field)))
                raise DefinitionError(f"`{field}` of {self.name} must have shape {list(shape)}; got {given}")
        if any(not -1 <= parent < i for i, parent in enumerate(self.parents)) or len(self.parents) != n:
            raise DefinitionError(f"`parents` of {self.name} must each be before their joint; got {self.parents}")
        for field in ("masses", "armature", "viscous", "coulomb"):
            self._require(field, known(getattr(self, field)) >= 0, "must be >= 0")
        for field in ("rotations", "translations", "centers", "inertias", "gravity_vector"):
            self._require(field, np.isfinite(known(getattr(self, field))), "must be finite")
        self._require("smoothing", known(self.smoothing) > 0, "must be > 0")

    def _require(self, field: str, holds: Any, rule: str) -> None:
        value = getattr(self, field)
        if is_traced(value):
            return
        fails = ~np.asarray(holds & np.isfinite(np.asarray(value)))
        if fails.any():
            at = tuple(np.argwhere(fails)[0].tolist())
            joint = f" for joint `{self.joint_names[at[0]]}`" if at and fails.shape[0] == self.joints else ""
            raise DefinitionError(f"`{field}` of {self.name} {rule}; got {np.asarray(value)[at]:g}{joint}")

    def mass(self, q: Vector) -> Matrix:
        """The inertia matrix `M(q)`, [n n], kg m², kg m, kg.

        - `q`: positions [n].
        """
        matrix: Matrix = _mass(self, q)
        return matrix

    def bias(self, q: Vector, dq: Vector) -> Vector:
        """`C(q,q̇) q̇ + G(q)`, [n], N m or N; friction is not in it.

        - `q`, `dq`: positions and velocities [n].
        """
        forces: Vector = _bias(self, q, dq)
        return forces

    def friction(self, dq: Vector) -> Vector:
        """`F(q̇) = f_c tanh(q̇/v_s) + f_v q̇`, [n], N m or N.

        - `dq`: velocities [n].
        """
        return self.coulomb * jnp.tanh(dq / self.smoothing) + self.viscous * dq

    def potential(self, q: Vector) -> Scalar:
        """The potential energy, J.

        - `q`: positions [n].
        """
        moment = jnp.sum(from_the_base(self._bodies(), self._frames(q)).moment, axis=1)
        return -jnp.sum(self.gravity_vector * moment)

    def tip(self, q: Vector) -> Float[Array, "3"]:
        """The tip's place in the base frame, [3], m.

        - `q`: positions [n].
        """
        return self.tip_frame(q)[1]

    def tip_frame(self, q: Vector) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """The tip's axes, as columns, and its place in the base frame, [3 3] and [3], m.

        - `q`: positions [n].
        """
        at = self._frames(q)
        rotation, place = at.rotation[..., self.tip_joint], at.place[:, self.tip_joint]
        turned = jnp.sum(rotation[:, :, None] * self.tip_rotation[None], axis=1)
        return turned, place + jnp.sum(rotation * self.tip_translation[None], axis=1)

    def frames(self, q: Vector) -> tuple[Float[Array, "n 3 3"], Float[Array, "n 3"]]:
        """Each joint's axes, as columns, and its place in the base frame, [n 3 3] and [n 3], m.

        - `q`: positions [n].
        """
        at = self._frames(q)
        return jnp.moveaxis(at.rotation, -1, 0), at.place.T

    @property
    def _revolute(self) -> tuple[bool, ...]:
        return tuple(unit == "rad" for unit in self.joint_units)

    def _frames(self, q: Vector) -> Frames:
        return frames(self.rotations, self.translations, self.parents, self._revolute, q)

    def _bodies(self) -> Bodies:
        """The links about their joints' origins, with the payload as part of the link that carries the tip."""
        links = _about_the_origin(self.masses, self.centers, self.inertias)
        r, load = self.tip_rotation, self.payload
        center = self.tip_translation + jnp.sum(r * load.center[None], axis=1)
        turned = jnp.sum(r[:, :, None] * load.inertia[None], axis=1)
        turned = jnp.sum(turned[:, None, :] * r[None], axis=2)
        carried = _about_the_origin(load.mass[None], center[None], turned[None])
        at_tip = np.arange(self.joints) == self.tip_joint
        return Bodies(*(link + jnp.where(at_tip, extra, 0.0) for link, extra in zip(links, carried, strict=True)))


# A law asks for these several times at each sample, and they are long: jit's memory saves tracing them anew.
@jax.jit
def _mass(arm: Articulated, q: Vector) -> Matrix:
    at = arm._frames(q)
    matrix = inertia_matrix(from_the_base(arm._bodies(), at), axes(at, arm._revolute), arm.parents)
    return matrix + jnp.where(np.eye(arm.joints, dtype=bool), arm.armature, 0.0)


@jax.jit
def _bias(arm: Articulated, q: Vector, dq: Vector) -> Vector:
    at = arm._frames(q)
    return bias_forces(from_the_base(arm._bodies(), at), axes(at, arm._revolute), arm.parents, dq, arm.gravity_vector)


def _about_the_origin(
    masses: Float[Array, " n"], centers: Float[Array, "n 3"], inertias: Float[Array, "n 3 3"]
) -> Bodies:
    square = jnp.sum(centers * centers, axis=1)
    entries = []
    for i, j in PAIRS:
        shift = (square if i == j else 0.0) - centers[:, i] * centers[:, j]
        entries.append(inertias[:, i, j] + masses * shift)
    return Bodies(mass=masses, moment=(masses[:, None] * centers).T, inertia=jnp.stack(entries))
