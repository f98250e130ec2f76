"""Articulated: an arm of rigid links in a tree of revolute and prismatic joints, and its equations of motion."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.core.errors import DefinitionError, require_shape
from slidax.core.parameter import parameter, parameters_of, piece
from slidax.core.tracing import barrier
from slidax.core.types import Matrix, Scalar, Vector

from .arm import AbstractRobot, JointLimits, Payload

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Row and column of each stored entry of a symmetric 3 x 3 matrix."""

INDICES = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
"""Index into `PAIRS` for each entry of the matrix."""


class Bodies(NamedTuple):
    """Mass properties of each link about an origin; those of rigidly connected bodies add up.

    - `mass`: [n], kg.
    - `moment`: mass times centre [3 n], kg m.
    - `inertia`: about the origin, entries `PAIRS` [6 n], kg m².
    """

    mass: Float[Array, " n"]
    moment: Float[Array, "3 n"]
    inertia: Float[Array, "6 n"]


class JointFrames(NamedTuple):
    """Axes of each joint's frame in the base frame, as columns [3 3 n], and its origin [3 n], m."""

    rotation: Float[Array, "3 3 n"]
    position: Float[Array, "3 n"]


class JointAxes(NamedTuple):
    """Velocity of each link for a unit velocity of its joint, in the base frame.

    - `angular`: [3 n]; 0 for a prismatic joint.
    - `linear`: velocity of the point of the extended link that is at the base's origin [3 n].
    """

    angular: Float[Array, "3 n"]
    linear: Float[Array, "3 n"]


def joint_frames(
    rotations: Float[Array, "n 3 3"],
    translations: Float[Array, "n 3"],
    parents: Sequence[int],
    revolute: Sequence[bool],
    q: Vector,
) -> JointFrames:
    """Return the joint frames in a posture: each joint turns about, or slides along, the z axis of its frame.

    - `rotations`, `translations`: each frame in its parent's frame, at position 0 [n 3 3], [n 3], m.
    - `parents`: index of each joint's parent, less than the joint's own; -1 for the base.
    - `revolute`: True for a revolute joint, False for a prismatic one.
    - `q`: positions [n], rad or m.
    """
    is_revolute = np.asarray(revolute)
    cosine, sine = barrier((jnp.where(is_revolute, jnp.cos(q), 1.0), jnp.where(is_revolute, jnp.sin(q), 0.0)))
    slide = jnp.where(is_revolute, 0.0, q)
    placed: list[tuple[Any, Any]] = []
    for i, parent in enumerate(parents):
        own = rotations[i], translations[i]
        moved = (cosine[i], sine[i]) if revolute[i] else (slide[i],)
        placed.append(_moved(own, moved) if parent < 0 else _behind(*placed[parent], own, moved))
    return JointFrames(
        rotation=jnp.stack([rotation for rotation, _ in placed], axis=-1),
        position=jnp.stack([position for _, position in placed], axis=-1),
    )


# With jit, all joints of a kind are traced once and share a function in exported C.
@jax.jit
def _behind(before: Any, at: Any, own: tuple[Any, Any], moved: tuple[Any, ...]) -> tuple[Any, Any]:
    """Return a joint's frame from its parent's frame."""
    rotation, position = own
    return _moved((_product(before, rotation), at + _image(before, position)), moved)


def _moved(frame: tuple[Any, Any], moved: tuple[Any, ...]) -> tuple[Any, Any]:
    """Rotate a frame about its z axis, by a cosine and a sine, or slide it along this axis."""
    rotation, position = frame
    x, y, z = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    if len(moved) == 2:
        cosine, sine = moved
        rotation = jnp.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)
    else:
        position = position + moved[0] * z
    # Without the barrier, XLA would recompute each frame for every later one.
    return barrier((rotation, position))


def joint_axes(at: JointFrames, revolute: Sequence[bool]) -> JointAxes:
    """Return the velocity of each link for a unit velocity of its joint.

    - `at`: the joints' frames in the base frame.
    - `revolute`: True for a revolute joint, False for a prismatic one.
    """
    z, is_revolute = at.rotation[:, 2], np.asarray(revolute)
    return JointAxes(angular=jnp.where(is_revolute, z, 0.0), linear=jnp.where(is_revolute, cross(at.position, z), z))


def about_base_origin(bodies: Bodies, at: JointFrames) -> Bodies:
    """Transform the links' mass properties from their joints' frames `at` to the base frame and its origin."""
    r, p, m = at.rotation, at.position, bodies.mass
    h = jnp.sum(r * bodies.moment[None], axis=1)
    full = bodies.inertia[np.asarray(INDICES)]
    half = jnp.sum(r[:, :, None] * full[None], axis=1)
    turned = [jnp.sum(half[i] * r[j], axis=0) for i, j in PAIRS]
    # J' about the joint's origin p becomes J = R J' Rᵀ + 2 (p·h) 1 - p hᵀ - h pᵀ + m (p·p 1 - p pᵀ) about the base's.
    # With a = h + m p/2: p hᵀ + h pᵀ + m p pᵀ = p aᵀ + a pᵀ.
    a = h + 0.5 * m * p
    trace = 2.0 * jnp.sum(p * a, axis=0)
    shifted = [t - (p[i] * a[j] + a[i] * p[j]) for t, (i, j) in zip(turned, PAIRS, strict=True)]
    shifted = [s + trace if i == j else s for s, (i, j) in zip(shifted, PAIRS, strict=True)]
    return Bodies(mass=m, moment=h + m * p, inertia=jnp.stack(shifted))


def inertia_matrix(bodies: Bodies, s: JointAxes, parents: Sequence[int]) -> Matrix:
    """Return the inertia matrix M [n n] by the composite-rigid-body algorithm.

    `M_ij = M_ji = S_i · I_j S_j` if joint i carries joint j, and 0 if neither carries the other. S_i is the velocity of
    link i for a unit velocity of its joint, and I_j the inertia of all links that joint j moves. The rotors' armature
    is not included.

    - `bodies`: links about the base's origin.
    - `s`: the velocities S_i.
    - `parents`: index of each joint's parent, -1 for the base.
    """
    carried = Bodies(*(_sum_over_descendants(part, parents) for part in barrier(bodies)))
    force, torque = barrier(momentum(carried, s.linear, s.angular))
    pairs = s.angular[:, :, None] * torque[:, None, :] + s.linear[:, :, None] * force[:, None, :]
    upper = jnp.sum(pairs, axis=0)
    carries = ancestry(parents)
    both = jnp.where(carries, upper, 0.0)
    own = np.eye(len(parents), dtype=bool)
    return both + jnp.where(own, 0.0, both.T)


def bias_forces(bodies: Bodies, s: JointAxes, parents: Sequence[int], dq: Vector, gravity: Float[Array, "3"]) -> Vector:
    """Return `C q̇ + G`, [n], by recursive Newton-Euler: the torques for zero joint acceleration, N m or N.

    - `bodies`: links about the base's origin.
    - `s`: velocity of each link for a unit velocity of its joint.
    - `parents`: index of each joint's parent, -1 for the base.
    - `dq`: joint velocities [n].
    - `gravity`: acceleration [3], m/s².
    """
    v, w, av, aw = motion_of_links(s, parents, dq, None, gravity)
    force, torque = momentum(bodies, *barrier((av, aw)))
    linear, angular = barrier(momentum(bodies, v, w))
    force = force + cross(w, linear)
    torque = torque + cross(w, angular) + cross(v, linear)
    force, torque = barrier((_sum_over_descendants(force, parents), _sum_over_descendants(torque, parents)))
    return jnp.sum(s.angular * torque + s.linear * force, axis=0)


def motion_of_links(
    s: JointAxes, parents: Sequence[int], dq: Vector, ddq: Vector | None, gravity: Float[Array, "3"]
) -> tuple[Array, Array, Array, Array]:
    """Return linear and angular velocity and acceleration of each link: v, w, v̇, ẇ, [3 n] each.

    v is the velocity of the point of the extended link that is at the base's origin.

    - `s`: velocity of each link for a unit velocity of its joint.
    - `parents`: index of each joint's parent, -1 for the base.
    - `dq`: joint velocities [n].
    - `ddq`: joint accelerations [n]; None for 0.
    - `gravity`: acceleration [3], m/s²; the base accelerates upwards, so that weight needs no term of its own.
    """
    own_w, own_v = s.angular * dq, s.linear * dq
    w, v = barrier((_sum_over_ancestors(own_w, parents), _sum_over_ancestors(own_v, parents)))
    turned, moved = cross(w, own_w), cross(w, own_v) + cross(v, own_w)
    if ddq is not None:
        turned, moved = turned + s.angular * ddq, moved + s.linear * ddq
    return v, w, _sum_over_ancestors(moved, parents) - gravity[:, None], _sum_over_ancestors(turned, parents)


def cross(a: Float[Array, "3 ..."], b: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
    """Return `a × b` for vectors with the component as the first axis."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def momentum(bodies: Bodies, linear: Any, angular: Any) -> tuple[Any, Any]:
    """Return linear and angular momentum of each link about the base's origin, [3 n] each.

    - `linear`, `angular`: velocity of each link's point at the base's origin, and its angular velocity [3 n].
    """
    full = bodies.inertia[np.asarray(INDICES)]
    momentum = bodies.mass * linear + cross(angular, bodies.moment)
    return momentum, jnp.sum(full * angular[None], axis=1) + cross(bodies.moment, linear)


def _sum_over_ancestors(own: Float[Array, "k n"], parents: Sequence[int]) -> Float[Array, "k n"]:
    """Return, for each joint, the sum over the joint and all its ancestors."""
    sums: list[Any] = []
    for i, parent in enumerate(parents):
        sums.append(own[:, i] + sums[parent] if parent >= 0 else own[:, i])
    return jnp.stack(sums, axis=-1)


def _sum_over_descendants(own: Float[Array, "... n"], parents: Sequence[int]) -> Float[Array, "... n"]:
    """Return, for each joint, the sum over the joint and all its descendants."""
    sums: list[Any] = [own[..., i] for i in range(len(parents))]
    for i, parent in reversed(list(enumerate(parents))):
        if parent >= 0:
            sums[parent] = sums[parent] + sums[i]
    return jnp.stack(sums, axis=-1)


def ancestry(parents: Sequence[int]) -> np.ndarray:
    """Return a matrix [n n], True at (i, j) if joint i is joint j or one of its ancestors.

    - `parents`: index of each joint's parent, -1 for the base.
    """
    carries = np.eye(len(parents), dtype=bool)
    for i, parent in enumerate(parents):
        if parent >= 0:
            carries[:, i] |= carries[:, parent]
    return carries


def _product(a: Float[Array, "3 3"], b: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def _image(a: Float[Array, "3 3"], x: Float[Array, "3"]) -> Float[Array, "3"]:
    return jnp.sum(a * x[None], axis=1)


class Articulated(AbstractRobot):
    """A tree of rigid links, `M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇) = τ + τ_d`, with a payload at its tip.

    Each joint turns about, or slides along, the z axis of its frame; `rotations` and `translations` are that frame in
    its parent's frame at position 0. M comes from the composite-rigid-body algorithm, with the rotors' armature on its
    diagonal, and the bias from recursive Newton-Euler (Featherstone, *Rigid Body Dynamics Algorithms*, 2008). Friction
    is `F = f_c tanh(q̇/v_s) + f_v q̇` with `coulomb`, `smoothing` and `viscous`.

    `slidax.arms.panda()` and the other built-in arms, `from_urdf`, `from_mjcf` and `assemble` return such arms. Each
    physical parameter is a leaf of the pytree, so `jax.vmap` can vary it. `Mismatch` derives the true arm from a
    nominal one.
    """

    rotations: Float[Array, "n 3 3"] = parameter("each joint's axes in its parent's frame, as columns")
    translations: Float[Array, "n 3"] = parameter("each joint's position in its parent's frame", "m")
    masses: Vector = parameter("masses of the links", "kg", ">= 0")
    centers: Float[Array, "n 3"] = parameter("centres of mass, in the joint's frame", "m")
    inertias: Float[Array, "n 3 3"] = parameter("inertias about the centres of mass, in the joint's axes", "kg m²")
    armature: Vector = parameter("rotor inertias at the joints", "kg m² or kg", ">= 0")
    viscous: Vector = parameter("viscous friction f_v", "N m s/rad or N s/m", ">= 0")
    coulomb: Vector = parameter("Coulomb friction f_c", "N m or N", ">= 0")
    smoothing: Scalar = parameter("v_s, width of Coulomb friction's smoothed sign change", "rad/s or m/s", "> 0")
    gravity_vector: Float[Array, "3"] = parameter("acceleration of gravity in the base frame", "m/s²")
    tip_rotation: Float[Array, "3 3"] = parameter("the tip's axes in the frame of the joint that carries it")
    tip_translation: Float[Array, "3"] = parameter("the tip's position in the frame of the joint that carries it", "m")
    payload: Payload = piece("payload at the tip")
    limits: JointLimits = piece("joint limits from the data sheet; the equations of motion ignore them")
    name: str = piece("name of the arm, for messages and figures", static=True)
    joint_names: tuple[str, ...] = piece("names of the joints", static=True)
    link_names: tuple[str, ...] = piece("names of the links that the joints move", static=True)
    parents: tuple[int, ...] = piece(
        "index of each joint's parent, less than the joint's own; -1 for the base", static=True
    )
    tip_joint: int = piece("index of the joint that carries the tip", static=True)
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
                raise DefinitionError(
                    f"`{field}` of {self.name} must have {n} entries, as many as `joint_units`; got {entries}"
                )
        if any(not -1 <= parent < i for i, parent in enumerate(self.parents)):
            raise DefinitionError(f"`parents` of {self.name} must be earlier joints or -1; got {self.parents}")

    def with_zero(self, offset: Vector) -> Articulated:
        """Return the arm with shifted zero positions: at `q` it has the posture of this arm at `q + offset`.

        - `offset`: true positions minus those of the encoders [n], rad or m.
        """
        z = jnp.zeros(self.joints)
        turns = jnp.asarray([unit == "rad" for unit in self.joint_units])
        cosine, sine = jnp.where(turns, jnp.cos(offset), 1.0), jnp.where(turns, jnp.sin(offset), 0.0)
        turn = jnp.stack([cosine, -sine, z, sine, cosine, z, z, z, z + 1.0], axis=1).reshape(-1, 3, 3)
        moved = self.translations + jnp.where(turns, 0.0, offset)[:, None] * self.rotations[:, :, 2]
        bounds = self.limits.lower - offset, self.limits.upper - offset
        return eqx.tree_at(
            lambda arm: (arm.rotations, arm.translations, arm.limits.lower, arm.limits.upper),
            self,
            (jnp.sum(self.rotations[:, :, :, None] * turn[:, None], axis=2), moved, *bounds),
        )

    def mass(self, q: Vector) -> Matrix:
        return _inertia(*_links(self, self.joint_frames(q)), self.armature, self.parents)

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return _bias(*_links(self, self.joint_frames(q)), dq, self.gravity_vector, self.parents)

    def friction(self, dq: Vector) -> Vector:
        """Return `F(q̇) = f_c tanh(q̇/v_s) + f_v q̇`, [n], N m or N."""
        return self.coulomb * jnp.tanh(dq / self.smoothing) + self.viscous * dq

    def potential(self, q: Vector) -> Scalar:
        moment = jnp.sum(about_base_origin(self.bodies(), self.joint_frames(q)).moment, axis=1)
        return -jnp.sum(self.gravity_vector * moment)

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.tip_frame(q)[1]

    def tip_frame(self, q: Vector) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Return the tip's axes, as columns, and its position in the base frame, [3 3] and [3], m."""
        at = self.joint_frames(q)
        rotation, position = at.rotation[..., self.tip_joint], at.position[:, self.tip_joint]
        turned = jnp.sum(rotation[:, :, None] * self.tip_rotation[None], axis=1)
        return turned, position + jnp.sum(rotation * self.tip_translation[None], axis=1)

    def frames(self, q: Vector) -> tuple[Float[Array, "n 3 3"], Float[Array, "n 3"]]:
        """Return each joint's axes, as columns, and its position in the base frame, [n 3 3] and [n 3], m."""
        at = self.joint_frames(q)
        return jnp.moveaxis(at.rotation, -1, 0), at.position.T

    @property
    def revolute(self) -> tuple[bool, ...]:
        """For each joint, True if it is revolute."""
        return tuple(unit == "rad" for unit in self.joint_units)

    def joint_frames(self, q: Vector) -> JointFrames:
        """Return the joint frames in the base frame at positions q [n]."""
        return _frames(self.rotations, self.translations, q, self.parents, self.revolute)

    def bodies(self) -> Bodies:
        """Return each link's mass properties about its joint's origin; the link with the tip includes the payload."""
        links = _about_the_origin(self.masses, self.centers, self.inertias)
        r, load = self.tip_rotation, self.payload
        center = self.tip_translation + jnp.sum(r * load.center[None], axis=1)
        turned = jnp.sum(r[:, :, None] * load.inertia[None], axis=1)
        turned = jnp.sum(turned[:, None, :] * r[None], axis=2)
        carried = _about_the_origin(load.mass[None], center[None], turned[None])
        at_tip = np.arange(self.joints) == self.tip_joint
        return Bodies(*(link + jnp.where(at_tip, extra, 0.0) for link, extra in zip(links, carried, strict=True)))


# A law calls these several times at each sample: the cache of jit avoids tracing them again, and exported C has a
# function for each. Results that two calls for the same posture share are computed once.
@functools.partial(jax.jit, static_argnames=("parents", "revolute"))
def _frames(
    rotations: Float[Array, "n 3 3"],
    translations: Float[Array, "n 3"],
    q: Vector,
    parents: tuple[int, ...],
    revolute: tuple[bool, ...],
) -> JointFrames:
    return joint_frames(rotations, translations, parents, revolute, q)


@jax.jit
def _links(arm: Articulated, at: JointFrames) -> tuple[Bodies, JointAxes]:
    return about_base_origin(arm.bodies(), at), joint_axes(at, arm.revolute)


@functools.partial(jax.jit, static_argnames="parents")
def _inertia(bodies: Bodies, moved: JointAxes, armature: Vector, parents: tuple[int, ...]) -> Matrix:
    matrix = inertia_matrix(bodies, moved, parents)
    return matrix + jnp.where(np.eye(len(parents), dtype=bool), armature, 0.0)


@functools.partial(jax.jit, static_argnames="parents")
def _bias(bodies: Bodies, moved: JointAxes, dq: Vector, gravity: Float[Array, "3"], parents: tuple[int, ...]) -> Vector:
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
