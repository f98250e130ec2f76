"""An arm as points with mass: inertia, its derivatives and inertial forces as inner products of point velocities.

A body with mass m, centre c and second moments Σ has the pseudo-inertia `J = [Σ m c; m cᵀ m]`. `J = PᵀP`, where the
rows of P are four points in homogeneous coordinates (x, w). A field that is affine on the body, such as its velocity,
has the same integral of squares over the body's mass and over these points. Let X(q) be the positions of all points, 12
numbers per body, `Y = ∂X/∂q` their Jacobian and `Ẏ_v` its rate for joint velocities v. Then

    M = YᵀY + diag(rotors),      C(q, v) = Yᵀ Ẏ_v,      inverse dynamics = Yᵀ (Ẍ - g) + rotors · q̈,

and `∂_j∂_k X = z_j × ∂_k X` for a revolute joint j with the axis z_j that is k or carries k. So all derivatives have
bounds in kg m² without any grid. An error ΔJ of the pseudo-inertia with `-C <= ΔJ <= C` changes the inner product of
two fields a and b by at most `‖a‖ ‖b‖`. Both norms are those on the four points of C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import PAIRS, Articulated
from slidax.core.errors import DefinitionError
from slidax.identify.band import arm_parameters
from slidax.identify.regressor import BODY

Floats = NDArray[np.float64]

Jet = list[Floats]
"""A quantity and its derivatives by time, each [times ...]."""


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """Kinematics and inertial parameters of an arm, with its bodies as points with mass.

    - `rotations`, `translations`: each joint's frame in its parent's frame [n 3 3], [n 3].
    - `revolute`: True for a revolute joint [n].
    - `before`: [n n], True where the row's joint is the column's joint or an ancestor of it.
    - `parents`: index of each joint's parent; below 0 for the base.
    - `pseudo_inertias`: J of each joint's body with its payload, in the joint's frame [n 4 4].
    - `points`: four points of each body, in homogeneous coordinates; the rows of P with `J = PᵀP` [n 4 4].
    - `rotors`: inertia of the rotors [n], kg m²; `gravity`: [3], m/s².
    """

    rotations: Floats
    translations: Floats
    revolute: NDArray[np.bool_]
    before: NDArray[np.bool_]
    parents: Sequence[int]
    pseudo_inertias: Floats
    points: Floats
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
        parameters = arm_parameters(arm)
        pseudo = pseudo_inertias(parameters[: BODY * n])
        for name, body in zip(arm.link_names, pseudo, strict=True):
            least, largest = np.linalg.eigvalsh(body)[[0, -1]]
            if least < -1e-6 * max(largest, 1e-12):
                raise DefinitionError(
                    f"no rigid body has the inertia of link `{name}`: its pseudo-inertia has the eigenvalue "
                    f"{least:.3g}, and all must be >= 0. So the arm has no band of inertial parameters; identify the "
                    "arm or correct its file"
                )
        return cls(
            rotations=np.asarray(arm.rotations),
            translations=np.asarray(arm.translations),
            revolute=np.array([unit == "rad" for unit in arm.joint_units], bool),
            before=before,
            parents=arm.parents,
            pseudo_inertias=pseudo,
            points=points_of(pseudo),
            rotors=parameters[BODY * n :],
            gravity=np.asarray(arm.gravity_vector),
        )

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.rotors)


def pseudo_inertias(parameters: Floats) -> Floats:
    """Return the pseudo-inertias `[Σ m c; m cᵀ m]` of bodies [... n 4 4], for mass m, centre c and second moments Σ.

    - `parameters`: ten per body: m, m c, and the inertia about the frame's origin, xx, yy, zz, xy, xz, yz [... 10n].
    """
    bodies = parameters.reshape(*parameters.shape[:-1], -1, BODY)
    inertia = np.empty((*bodies.shape[:-1], 3, 3))
    for entry, (i, j) in enumerate(PAIRS):
        inertia[..., i, j] = inertia[..., j, i] = bodies[..., 4 + entry]
    pseudo = np.empty((*bodies.shape[:-1], 4, 4))
    half_trace = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)
    pseudo[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - inertia
    pseudo[..., :3, 3] = pseudo[..., 3, :3] = bodies[..., 1:4]
    pseudo[..., 3, 3] = bodies[..., 0]
    return pseudo


def points_of(pseudo: Floats) -> Floats:
    """Return four points of each pseudo-inertia J, in homogeneous coordinates: the rows of P with `PᵀP = J`, [... 4 4].

    - `pseudo`: J [... 4 4].
    """
    values, vectors = np.linalg.eigh(pseudo)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[..., :, None] * vectors.swapaxes(-1, -2))


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Motion of the bodies' points X at several times; X has D = 12 n coordinates, three for each of four points.

    - `columns`: the Jacobian `Y = ∂X/∂q` and its first two derivatives by time, each [times D n].
    - `acceleration`: `Ẍ - g` [times D]; `jerk`: `X⃛` [times D].
    """

    columns: tuple[Floats, Floats, Floats]
    acceleration: Floats
    jerk: Floats


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Motion of the joints' frames at several times. Each frame counts as four points: its three axes and its origin.

    - `columns`: derivatives of the points by the joint positions, and their first two derivatives by time. Each is
      [times n n 4 3], for time, joint, frame, point and coordinate.
    - `acceleration`: acceleration of the points less gravity [times n 4 3]; `jerk`: their jerk [times n 4 3].
    - `axes`: the joints' axes of rotation z [times n 3]; 0 for a prismatic joint.
    """

    columns: tuple[Floats, Floats, Floats]
    acceleration: Floats
    jerk: Floats
    axes: Floats

    def of(self, points: Floats) -> PointMotion:
        """Return the motion of points that are fixed to the frames.

        - `points`: points in homogeneous coordinates [n 4 4].
        """
        count, n = self.axes.shape[:2]
        # For each body: the map from the 12 coordinates of its frame to the 12 coordinates of its points.
        maps = np.einsum("bpq,xy->bqxpy", points, np.eye(3)).reshape(n, 12, 12)

        def moved(frames: Floats) -> Floats:
            values = np.empty((frames[..., 0, 0, 0].size, n, 12))
            np.matmul(frames.reshape(values.shape).swapaxes(0, 1), maps, out=values.swapaxes(0, 1))
            return values.reshape(*frames.shape[:-3], -1)

        return PointMotion(
            columns=tuple(moved(part).swapaxes(1, 2) for part in self.columns),  # type: ignore[arg-type]
            acceleration=moved(self.acceleration).reshape(count, -1),
            jerk=moved(self.jerk).reshape(count, -1),
        )


def frame_motion(bodies: BodyPoints, q: Floats, dq: Floats, ddq: Floats, dddq: Floats) -> FrameMotion:
    """Return the motion of the joints' frames for a motion of the joints.

    - `q`, `dq`, `ddq`, `dddq`: positions and their derivatives [times n].
    """
    count, n = q.shape
    turns, places = _frames(bodies, [q, dq, ddq, dddq])
    axes: list[Jet] = [[part[:, :, 2] for part in turn] for turn in turns]
    # The rows of each frame's rotation are its axes.
    points = [
        np.stack(
            [
                np.concatenate([turn[order].swapaxes(1, 2), place[order][:, None]], axis=1)
                for turn, place in zip(turns, places, strict=True)
            ],
            axis=1,
        )
        for order in range(4)
    ]
    columns: list[Floats] = [np.zeros((count, n, n, 4, 3)) for _ in range(3)]
    for k in range(n):
        behind = np.flatnonzero(bodies.before[k])
        if bodies.revolute[k]:
            arms = [points[order][:, behind] for order in range(3)]
            for order, arm in enumerate(arms):
                arm[:, :, 3] -= places[k][order][:, None]
            axis = [part[:, None, None] for part in axes[k]]
            columns[0][:, k, behind] = np.cross(axis[0], arms[0])
            columns[1][:, k, behind] = np.cross(axis[1], arms[0]) + np.cross(axis[0], arms[1])
            columns[2][:, k, behind] = (
                np.cross(axis[2], arms[0]) + 2.0 * np.cross(axis[1], arms[1]) + np.cross(axis[0], arms[2])
            )
        else:
            for order in range(3):
                columns[order][:, k, behind, 3] = axes[k][order][:, None]
    acceleration = points[2]
    acceleration[:, :, 3] -= bodies.gravity
    return FrameMotion(
        columns=(columns[0], columns[1], columns[2]),
        acceleration=acceleration,
        jerk=points[3],
        axes=np.where(bodies.revolute[:, None], np.stack([axis[0] for axis in axes], axis=1), 0.0),
    )


def _frames(bodies: BodyPoints, motion: Jet) -> tuple[list[Jet], list[Jet]]:
    """Return each joint's axes and origin in the base frame, with three derivatives by time."""
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
    """Return the derivatives of a product of matrices, by Leibniz's rule."""
    choose = ((1,), (1, 1), (1, 2, 1), (1, 3, 3, 1))
    return [
        sum((row[i] * (a[i] @ b[order - i]) for i in range(order + 1)), np.zeros(()))
        for order, row in enumerate(choose)
    ]
