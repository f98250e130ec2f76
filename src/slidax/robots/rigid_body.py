"""Equations of a tree of rigid links: frames, composite inertia, Newton-Euler forces.

All quantities are in the base frame and about its origin, so no vector is rotated from link to link: sums run along
the tree, and all other arithmetic runs over all joints at once. (Featherstone, *Rigid Body Dynamics Algorithms*,
2008, gives both algorithms in link coordinates.) Vectors have their component as the first axis and the joint as the
last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.numerics import once
from slidax.parts import Matrix, Vector

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""The entries of a symmetric 3 x 3 matrix that are kept."""

PLACES = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
"""Where each entry of the matrix stands among those."""


class Bodies(NamedTuple):
    """Inertia of each link about an origin; the values of bodies that move together add up.

    - `mass`: [n], kg.
    - `moment`: mass times centre [3 n], kg m.
    - `inertia`: about the origin, entries `PAIRS` [6 n], kg m².
    """

    mass: Float[Array, " n"]
    moment: Float[Array, "3 n"]
    inertia: Float[Array, "6 n"]


class JointFrames(NamedTuple):
    """Axes of each joint's frame as columns [3 3 n], and its origin [3 n], m."""

    rotation: Float[Array, "3 3 n"]
    place: Float[Array, "3 n"]


class Axes(NamedTuple):
    """Velocity of each link for a unit velocity of its joint.

    - `angular`: [3 n]; 0 for a prismatic joint.
    - `linear`: of the point that passes through the base's origin [3 n].
    """

    angular: Float[Array, "3 n"]
    linear: Float[Array, "3 n"]


def frames(
    rotations: Float[Array, "n 3 3"],
    translations: Float[Array, "n 3"],
    parents: Sequence[int],
    revolute: Sequence[bool],
    q: Vector,
) -> JointFrames:
    """Return the joint frames in a posture: each joint turns about, or slides along, the z axis of its frame.

    - `rotations`, `translations`: each frame in its parent's frame, at position 0.
    - `parents`: index of each joint's parent, less than its own; -1 for the base.
    - `q`: positions [n], rad or m.
    """
    turns = np.asarray(revolute)
    cosine, sine = once((jnp.where(turns, jnp.cos(q), 1.0), jnp.where(turns, jnp.sin(q), 0.0)))
    slide = jnp.where(turns, 0.0, q)
    placed: list[tuple[Any, Any]] = []
    for i, parent in enumerate(parents):
        own = rotations[i], translations[i]
        moved = (cosine[i], sine[i]) if revolute[i] else (slide[i],)
        placed.append(_moved(own, moved) if parent < 0 else _behind(*placed[parent], own, moved))
    return JointFrames(
        rotation=jnp.stack([rotation for rotation, _ in placed], axis=-1),
        place=jnp.stack([place for _, place in placed], axis=-1),
    )


# Traced once for all joints of a kind, and a function in exported C.
@jax.jit
def _behind(before: Any, at: Any, own: tuple[Any, Any], moved: tuple[Any, ...]) -> tuple[Any, Any]:
    """Frame of a joint from its parent's frame."""
    rotation, place = own
    return _moved((_product(before, rotation), at + _image(before, place)), moved)


def _moved(frame: tuple[Any, Any], moved: tuple[Any, ...]) -> tuple[Any, Any]:
    """Rotate a frame, by a cosine and a sine, or slide it."""
    rotation, place = frame
    x, y, z = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    if len(moved) == 2:
        cosine, sine = moved
        rotation = jnp.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)
    else:
        place = place + moved[0] * z
    # Without this XLA would compute each frame anew in every one behind it.
    return once((rotation, place))


def axes(at: JointFrames, revolute: Sequence[bool]) -> Axes:
    """Return the velocity that each joint gives its link."""
    z, turns = at.rotation[:, 2], np.asarray(revolute)
    return Axes(angular=jnp.where(turns, z, 0.0), linear=jnp.where(turns, cross(at.place, z), z))


def from_the_base(bodies: Bodies, at: JointFrames) -> Bodies:
    """Transform the links' inertia from each joint's frame to the base frame and its origin."""
    r, p, m = at.rotation, at.place, bodies.mass
    h = jnp.sum(r * bodies.moment[None], axis=1)
    full = bodies.inertia[np.asarray(PLACES)]
    half = jnp.sum(r[:, :, None] * full[None], axis=1)
    turned = [jnp.sum(half[i] * r[j], axis=0) for i, j in PAIRS]
    # J = R J' Rᵀ + 2 (p·h) 1 - p hᵀ - h pᵀ + m (p·p 1 - p pᵀ), with a = h + m p/2: p hᵀ + h pᵀ + m p pᵀ = p aᵀ + a pᵀ.
    a = h + 0.5 * m * p
    trace = 2.0 * jnp.sum(p * a, axis=0)
    shifted = [t - (p[i] * a[j] + a[i] * p[j]) for t, (i, j) in zip(turned, PAIRS, strict=True)]
    shifted = [s + trace if i == j else s for s, (i, j) in zip(shifted, PAIRS, strict=True)]
    return Bodies(mass=m, moment=h + m * p, inertia=jnp.stack(shifted))


def inertia_matrix(bodies: Bodies, s: Axes, parents: Sequence[int]) -> Matrix:
    """Return `M`, [n n], by composite rigid bodies: `M_ij = S_i · I_j S_j`.

    Joint i carries joint j, and I_j is the inertia of all links that j moves.

    - `bodies`: about the base's origin.
    - `s`: velocity of each link for a unit velocity of its joint.
    """
    carried = Bodies(*(_down_to_the_base(part, parents) for part in once(bodies)))
    force, torque = once(_momentum(carried, s.linear, s.angular))
    pairs = s.angular[:, :, None] * torque[:, None, :] + s.linear[:, :, None] * force[:, None, :]
    upper = jnp.sum(pairs, axis=0)
    carries = _carries(parents)
    both = jnp.where(carries, upper, 0.0)
    own = np.eye(len(parents), dtype=bool)
    return both + jnp.where(own, 0.0, both.T)


def bias_forces(bodies: Bodies, s: Axes, parents: Sequence[int], dq: Vector, gravity: Float[Array, "3"]) -> Vector:
    """Return `C q̇ + G`, [n], by recursive Newton-Euler: the torques for zero joint acceleration.

    - `bodies`: about the base's origin.
    - `s`: velocity of each link for a unit velocity of its joint.
    - `gravity`: acceleration [3], m/s².
    """
    own_w, own_v = s.angular * dq, s.linear * dq
    w, v = once((_along_the_tree(own_w, parents), _along_the_tree(own_v, parents)))
    # The base accelerates upwards: so weight needs no term of its own.
    aw = _along_the_tree(cross(w, own_w), parents)
    av = _along_the_tree(cross(w, own_v) + cross(v, own_w), parents) - gravity[:, None]
    force, torque = _momentum(bodies, *once((av, aw)))
    linear, angular = once(_momentum(bodies, v, w))
    force = force + cross(w, linear)
    torque = torque + cross(w, angular) + cross(v, linear)
    force, torque = once((_down_to_the_base(force, parents), _down_to_the_base(torque, parents)))
    return jnp.sum(s.angular * torque + s.linear * force, axis=0)


def cross(a: Float[Array, "3 ..."], b: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
    """Return `a × b` for vectors with the component as the first axis."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _momentum(bodies: Bodies, linear: Any, angular: Any) -> tuple[Any, Any]:
    """Linear and angular momentum about the base's origin [3 n]."""
    full = bodies.inertia[np.asarray(PLACES)]
    momentum = bodies.mass * linear + cross(angular, bodies.moment)
    return momentum, jnp.sum(full * angular[None], axis=1) + cross(bodies.moment, linear)


def _along_the_tree(own: Float[Array, "k n"], parents: Sequence[int]) -> Float[Array, "k n"]:
    """For each joint, the sum over the joint and all its ancestors."""
    sums: list[Any] = []
    for i, parent in enumerate(parents):
        sums.append(own[:, i] + sums[parent] if parent >= 0 else own[:, i])
    return jnp.stack(sums, axis=-1)


def _down_to_the_base(own: Float[Array, "... n"], parents: Sequence[int]) -> Float[Array, "... n"]:
    """For each joint, the sum over the joint and all its descendants."""
    sums: list[Any] = [own[..., i] for i in range(len(parents))]
    for i, parent in reversed(list(enumerate(parents))):
        if parent >= 0:
            sums[parent] = sums[parent] + sums[i]
    return jnp.stack(sums, axis=-1)


def _carries(parents: Sequence[int]) -> np.ndarray:
    """Matrix [n n], True where the first joint is the second or one of its ancestors."""
    carries = np.eye(len(parents), dtype=bool)
    for i, parent in enumerate(parents):
        if parent >= 0:
            carries[:, i] |= carries[:, parent]
    return carries


def _product(a: Float[Array, "3 3"], b: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def _image(a: Float[Array, "3 3"], x: Float[Array, "3"]) -> Float[Array, "3"]:
    return jnp.sum(a * x[None], axis=1)
