"""An arm as points with mass: inertia, its derivatives and inertial forces as inner products of point velocities.

A rigid body with mass m, centre c and second moments Σ moves like three directions `√Σ` and one point `√m (c, 1)`: any
field that is affine on the body has the same integral of squares over them. With the positions of all of them stacked
in one vector X(q) of 12 numbers per body (`√` of mass is in them),

    M = YᵀY + diag(rotors),  Y = ∂X/∂q,      C(q, v) = Yᵀ Ẏ_v,      inverse dynamics = Yᵀ (Ẍ - g) + rotors · q̈,

and the second derivatives are `∂_j∂_k X = z_j × ∂_k X` for a revolute joint j before or at k. So all derivatives have
bounds in kg m² without any grid. A pseudo-inertia that is wrong by at most a share p, `-p J0 <= ΔJ <= p J0`, changes
an inner product of two fields by at most `p ‖a‖ ‖b‖` on each body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError

Floats = NDArray[np.float64]

Jet = list[Floats]
"""A quantity and its derivatives by time, each [N ...]."""


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """The numbers of an arm that its motion needs.

    - `rotations`, `translations`: each joint's frame in its parent's [n 3 3], [n 3].
    - `revolute`: [n]; `before`: [n n], True where the row's joint is the column's or one of its ancestors.
    - `carrier`: the joint that carries each body [m]; the links come first, then a payload.
    - `points`: the four points of each body in its joint's frame, the first three are directions [m 4 3], m √kg.
    - `weights`: 0 for directions and √mass for points [m 4].
    - `rotors`: inertia of the rotors [n], kg m²; `gravity`: [3], m/s².
    """

    rotations: Floats
    translations: Floats
    revolute: NDArray[np.bool_]
    before: NDArray[np.bool_]
    parents: Sequence[int]
    carrier: NDArray[np.intp]
    points: Floats
    weights: Floats
    rotors: Floats
    gravity: Floats

    @classmethod
    def of(cls, arm: Articulated) -> BodyPoints:
        """Return the bodies of an arm.

        Raises DefinitionError if no distribution of mass has the inertia of a link.
        """
        n = arm.joints
        before = np.eye(n, dtype=bool)
        for i, parent in enumerate(arm.parents):
            if parent >= 0:
                before[:, i] |= before[:, parent]
        masses, centers, inertias = (np.asarray(value) for value in (arm.masses, arm.centers, arm.inertias))
        links = [(i, float(masses[i]), centers[i], inertias[i]) for i in range(n)]
        load, turn = arm.payload, np.asarray(arm.tip_rotation)
        if float(load.mass) > 0.0:
            center = np.asarray(arm.tip_translation) + turn @ np.asarray(load.center)
            links.append((arm.tip_joint, float(load.mass), center, turn @ np.asarray(load.inertia) @ turn.T))
        names = (*arm.link_names, "payload")
        points = [_points(name, *link[1:]) for name, link in zip(names, links, strict=False)]
        return cls(
            rotations=np.asarray(arm.rotations),
            translations=np.asarray(arm.translations),
            revolute=np.array([unit == "rad" for unit in arm.joint_units], bool),
            before=before,
            parents=arm.parents,
            carrier=np.array([link[0] for link in links]),
            points=np.stack([place for place, _ in points]),
            weights=np.stack([weight for _, weight in points]),
            rotors=np.asarray(arm.armature, float),
            gravity=np.asarray(arm.gravity_vector),
        )

    @property
    def joints(self) -> int:
        return len(self.rotors)


def _points(name: str, mass: float, center: Floats, inertia: Floats) -> tuple[Floats, Floats]:
    """The four points of a body, and their weights."""
    spread, axes = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    if spread[0] < -1e-6 * max(abs(spread[-1]), 1e-12):
        raise DefinitionError(
            f"the inertia of link `{name}` is of no rigid body (second moment {spread[0]:.3g} kg m²), so that no band "
            "of inertial parameters around it exists; identify the arm or correct its file"
        )
    directions = np.sqrt(np.maximum(spread, 0.0))[:, None] * axes.T
    return np.concatenate([directions, np.sqrt(mass) * center[None]]), np.array([0.0, 0.0, 0.0, np.sqrt(mass)])


@dataclass(frozen=True, eq=False)
class PointMotion:
    """The points of an arm along a motion, at N times; D numbers, 12 for each body.

    - `columns`: Y and its first two derivatives by time, each [N D n].
    - `slopes`: `∂_j Y` [N D n n], symmetric in its last two axes.
    - `acceleration`: `Ẍ - g` [N D], and `jerk`: `X⃛` [N D].
    - `axes`: the joints' axes of rotation z [N n 3]; 0 for a prismatic joint.
    """

    columns: tuple[Floats, Floats, Floats]
    slopes: Floats
    acceleration: Floats
    jerk: Floats
    axes: Floats


def point_motion(bodies: BodyPoints, q: Floats, dq: Floats, ddq: Floats, dddq: Floats) -> PointMotion:
    """Return the points of an arm along a motion.

    - `q`, `dq`, `ddq`, `dddq`: positions and their derivatives [N n].
    """
    count, n = q.shape
    turns, places = _frames(bodies, [q, dq, ddq, dddq])
    axes: list[Jet] = [[part[:, :, 2] for part in turn] for turn in turns]
    columns: list[Floats] = [np.zeros((count, n, len(bodies.carrier), 4, 3)) for _ in range(3)]
    points = [np.empty((count, len(bodies.carrier), 4, 3)) for _ in range(4)]
    for b, joint in enumerate(bodies.carrier):
        local, weight = bodies.points[b], bodies.weights[b]
        for order in range(4):
            points[order][:, b] = (
                local @ turns[joint][order].swapaxes(1, 2) + weight[:, None] * places[joint][order][:, None]
            )
    for k in range(n):
        moved = np.flatnonzero(bodies.before[k, bodies.carrier])
        weight = bodies.weights[moved]
        if bodies.revolute[k]:
            arms = [points[i][:, moved] - weight[..., None] * places[k][i][:, None, None] for i in range(3)]
            axis = [part[:, None, None] for part in axes[k]]
            columns[0][:, k, moved] = np.cross(axis[0], arms[0])
            columns[1][:, k, moved] = np.cross(axis[1], arms[0]) + np.cross(axis[0], arms[1])
            columns[2][:, k, moved] = (
                np.cross(axis[2], arms[0]) + 2.0 * np.cross(axis[1], arms[1]) + np.cross(axis[0], arms[2])
            )
        else:
            for order in range(3):
                columns[order][:, k, moved] = weight[..., None] * axes[k][order][:, None, None]
    slopes = np.zeros((count, n, n, len(bodies.carrier), 4, 3))
    for j in range(n):
        if bodies.revolute[j]:
            behind = np.flatnonzero(bodies.before[j])
            turned = np.cross(axes[j][0][:, None, None, None], columns[0][:, behind])
            slopes[:, j, behind] = turned
            slopes[:, behind, j] = turned
    weighted = bodies.weights[..., None] * bodies.gravity
    flat = (count, -1)
    return PointMotion(
        columns=tuple(part.reshape(count, n, -1).swapaxes(1, 2) for part in columns),  # type: ignore[arg-type]
        slopes=np.moveaxis(slopes.reshape(count, n, n, -1), 3, 1),
        acceleration=(points[2] - weighted).reshape(flat),
        jerk=points[3].reshape(flat),
        axes=np.where(bodies.revolute[:, None], np.stack([axis[0] for axis in axes], axis=1), 0.0),
    )


def _frames(bodies: BodyPoints, motion: Jet) -> tuple[list[Jet], list[Jet]]:
    """Each joint's axes and place in the base frame, with three derivatives by time."""
    q, v, a, j = motion
    cosine, sine = np.cos(q), np.sin(q)
    # Derivatives of e^{iq}: by time once, twice and three times.
    first, second = v * 1j, a * 1j - v * v
    third = 1j * j - 3.0 * v * a - 1j * v**3
    unit = cosine + 1j * sine
    circle = [unit, unit * first, unit * second, unit * third]
    turns: list[Jet] = []
    places: list[Jet] = []
    for i, parent in enumerate(bodies.parents):
        rotation, translation = bodies.rotations[i], bodies.translations[i]
        if parent < 0:
            base = [np.broadcast_to(rotation, (len(q), 3, 3)), *[np.zeros((len(q), 3, 3))] * 3]
            place = [np.broadcast_to(translation, (len(q), 3)), *[np.zeros((len(q), 3))] * 3]
        else:
            base = [part @ rotation for part in turns[parent]]
            place = [at + part @ translation for at, part in zip(places[parent], turns[parent], strict=True)]
        if bodies.revolute[i]:
            spin = [_about_z(part[:, i], float(order == 0)) for order, part in enumerate(circle)]
            turns.append(_leibniz(base, spin))
        else:
            turns.append(base)
            slide = [part[:, i, None, None] for part in motion]
            along = _leibniz([part[:, :, 2:] for part in base], slide)
            place = [at + shift[..., 0] for at, shift in zip(place, along, strict=True)]
        places.append(place)
    return turns, places


def _about_z(value: Any, still: float) -> Floats:
    result = np.zeros((len(value), 3, 3))
    result[:, 0, 0] = result[:, 1, 1] = value.real
    result[:, 1, 0], result[:, 0, 1] = value.imag, -value.imag
    result[:, 2, 2] = still
    return result


def _leibniz(a: Jet, b: Jet) -> Jet:
    """Derivatives of a product of matrices."""
    choose = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))
    return [
        sum((row[i] * (a[i] @ b[order - i]) for i in range(order + 1)), np.zeros(()))
        for order, row in enumerate(choose)
    ]
