"""The equations of a tree of rigid links: frames, composite inertia, Newton-Euler forces.

Everything is seen from the base and about its origin, so that no number is rotated from link to link: what adds up
along the tree is added, and the rest is the same arithmetic for all joints side by side. (Featherstone, *Rigid Body
Dynamics Algorithms*, 2008, gives both algorithms in link coordinates.) Vectors have their component as the first axis
and the joint as the last.
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
    """The inertia of each link about an origin; bodies that move together add up.

    - `mass`: [n], kg.
    - `moment`: mass times centre [3 n], kg m.
    - `inertia`: about the origin, entries `PAIRS` [6 n], kg m².
    """

    mass: Float[Array, " n"]
    moment: Float[Array, "3 n"]
    inertia: Float[Array, "6 n"]


class JointFrames(NamedTuple):
    """Where the joints are.

    - `rotation`: axes of each joint's frame as columns [3 3 n].
    - `place`: its origin [3 n], m.
    """

    rotation: Float[Array, "3 3 n"]
    place: Float[Array, "3 n"]


class Axes(NamedTuple):
    """The velocity of each link for a unit velocity of its joint.

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
    """Where the joints are in a posture: each turns about, or slides along, the z axis of its own frame.

    - `rotations`, `translations`: of each frame in its parent's, at position 0.
    - `parents`: number of each joint's parent, less than its own; -1 for the base.
    - `revolute`: whether each joint turns.
    - `q`: positions [n], rad or m.
    """
    turns = np.asarray(revolute)
    cosine, sine = once((jnp.where(turns, jnp.cos(q), 1.0), jnp.where(turns, jnp.sin(q), 0.0)))
    slide = jnp.where(turns, 0.0, q)
    seen: list[tuple[Any, Any]] = []
    for i, parent in enumerate(parents):
        own = rotations[i], translations[i]
        moved = (cosine[i], sine[i]) if revolute[i] else (slide[i],)
        seen.append(_moved(own, moved) if parent < 0 else _behind(*seen[parent], own, moved))
    return JointFrames(
        rotation=jnp.stack([rotation for rotation, _ in seen], axis=-1),
        place=jnp.stack([place for _, place in seen], axis=-1),
    )


# Traced once for all joints of a kind, and a function in exported C.
@jax.jit
def _behind(before: Any, at: Any, own: tuple[Any, Any], moved: tuple[Any, ...]) -> tuple[Any, Any]:
    """The frame of a joint from that of its parent."""
    rotation, place = own
    return _moved((_product(before, rotation), at + _image(before, place)), moved)


def _moved(frame: tuple[Any, Any], moved: tuple[Any, ...]) -> tuple[Any, Any]:
    """A frame that has turned, by a cosine and a sine, or has slid."""
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
    """How each joint moves its link.

    - `at`: where the joints are.
    - `revolute`: whether each turns.
    """
    z, turns = at.rotation[:, 2], np.asarray(revolute)
    return Axes(angular=jnp.where(turns, z, 0.0), linear=jnp.where(turns, cross(at.place, z), z))


def from_the_base(bodies: Bodies, at: JointFrames) -> Bodies:
    """The links' inertia about the base's origin and along its axes.

    - `bodies`: about each joint's origin and along its frame's axes.
    - `at`: where the joints are.
    """
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
    """`M`, [n n], by composite rigid bodies: `M_ij = S_i · I_j S_j`, where i carries j and I_j is all that j moves.

    - `bodies`: about the base's origin.
    - `s`: how each joint moves its link.
    - `parents`: number of each joint's parent.
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
    """`C q̇ + G`, [n], by recursive Newton-Euler: the torques that keep the joints from accelerating.

    - `bodies`: about the base's origin.
    - `s`: how each joint moves its link.
    - `parents`: number of each joint's parent.
    - `dq`: velocities [n].
    - `gravity`: its acceleration [3], m/s².
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
    """`a × b`, component by component.

    - `a`, `b`: vectors with the component as the first axis.
    """
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _momentum(bodies: Bodies, linear: Any, angular: Any) -> tuple[Any, Any]:
    """Linear and angular momentum about the base's origin [3 n], of links with these velocities there."""
    full = bodies.inertia[np.asarray(PLACES)]
    momentum = bodies.mass * linear + cross(angular, bodies.moment)
    return momentum, jnp.sum(full * angular[None], axis=1) + cross(bodies.moment, linear)


def _along_the_tree(own: Float[Array, "k n"], parents: Sequence[int]) -> Float[Array, "k n"]:
    """For each joint the sum over itself and all that carry it."""
    sums: list[Any] = []
    for i, parent in enumerate(parents):
        sums.append(own[:, i] + sums[parent] if parent >= 0 else own[:, i])
    return jnp.stack(sums, axis=-1)


def _down_to_the_base(own: Float[Array, "... n"], parents: Sequence[int]) -> Float[Array, "... n"]:
    """For each joint the sum over itself and all that it carries."""
    sums: list[Any] = [own[..., i] for i in range(len(parents))]
    for i, parent in reversed(list(enumerate(parents))):
        if parent >= 0:
            sums[parent] = sums[parent] + sums[i]
    return jnp.stack(sums, axis=-1)


def _carries(parents: Sequence[int]) -> np.ndarray:
    """[n n], whether the first joint carries the second or is it."""
    carries = np.eye(len(parents), dtype=bool)
    for i, parent in enumerate(parents):
        if parent >= 0:
            carries[:, i] |= carries[:, parent]
    return carries


def _product(a: Float[Array, "3 3"], b: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def _image(a: Float[Array, "3 3"], x: Float[Array, "3"]) -> Float[Array, "3"]:
    return jnp.sum(a * x[None], axis=1)
