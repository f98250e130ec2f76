"""The torque of a rigid arm as a regressor matrix times inertial parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slidax.arms.arm import Payload
from slidax.arms.articulated import Articulated

BODY = 10
"""Numbers of a body: mass, mass times centre, inertia about the frame's origin as xx, yy, zz, xy, xz, yz."""

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class JointMotion(NamedTuple):
    """Positions, velocities and accelerations over time.

    - `q`, `dq`, `ddq`: [k n].
    """

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray


class LinkMotion(NamedTuple):
    """Where each joint's frame is, and how it moves, in its own axes.

    - `rotation`: its axes in the base frame, as columns [n k 3 3].
    - `place`: its origin in the base frame [n k 3], m.
    - `omega`, `alpha`: angular velocity and acceleration [n k 3].
    - `rise`: acceleration of its origin, less gravity [n k 3], m/s².
    """

    rotation: np.ndarray
    place: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    rise: np.ndarray


def links_regressor(robot: Articulated, motion: JointMotion) -> np.ndarray:
    """`Y` with `M(q) q̈ + C(q,q̇) q̇ + G(q) = Y φ` for the links alone, [k n 10n].

    Newton's and Euler's equations are linear in mass, mass times centre and the inertia about a frame's origin
    (Atkeson, An and Hollerbach, *Estimation of inertial parameters of manipulator loads and links*, 1986). Rotors,
    friction and payload are not in it.

    - `robot`: its frames; what its links weigh does not matter.
    - `motion`: at k times.
    """
    links = _links(robot, motion)
    n = robot.joints
    columns = np.zeros((len(motion.q), n, n * BODY))
    for body in range(n):
        force, torque = _wrench(links.omega[body], links.alpha[body], links.rise[body])
        _onto_joints(columns[:, :, body * BODY :][:, :, :BODY], robot, links, body, force, torque)
    return columns


def rigid_torque(robot: Articulated, motion: JointMotion, phi: np.ndarray, payload: np.ndarray) -> np.ndarray:
    """`M(q) q̈ + C(q,q̇) q̇ + G(q)` for known bodies, without rotors, [k n]: as the regressors' times φ, but sooner.

    - `robot`: its frames.
    - `motion`: at k times.
    - `phi`: of the links [10n].
    - `payload`: of what the tip carries [10].
    """
    links = _links(robot, motion)
    total = np.zeros((len(motion.q), robot.joints))
    column = np.zeros((len(motion.q), robot.joints, 1))
    for body in range(robot.joints):
        wrench = _wrench(links.omega[body], links.alpha[body], links.rise[body])
        force, torque = (part @ phi[body * BODY :][:BODY, None] for part in wrench)
        if body == robot.tip_joint:
            force, torque = (
                a + b @ payload[:, None] for a, b in zip((force, torque), _carried(robot, links), strict=True)
            )
        column[:] = 0.0
        _onto_joints(column, robot, links, body, force, torque)
        total += column[:, :, 0]
    return total


def payload_regressor(robot: Articulated, motion: JointMotion) -> np.ndarray:
    """`Y` with `Y φ` the torque that what the tip carries adds, [k n 10], φ in the tip's frame.

    - `robot`: its frames.
    - `motion`: at k times.
    """
    links = _links(robot, motion)
    columns = np.zeros((len(motion.q), robot.joints, BODY))
    _onto_joints(columns, robot, links, robot.tip_joint, *_carried(robot, links))
    return columns


def _carried(robot: Articulated, links: LinkMotion) -> tuple[np.ndarray, np.ndarray]:
    """The wrench of what the tip carries, about the origin of the joint that carries the tip and in its axes."""
    at, turn, place = robot.tip_joint, np.asarray(robot.tip_rotation), np.asarray(robot.tip_translation)
    omega, alpha = links.omega[at], links.alpha[at]
    rise = links.rise[at] + _cross(alpha, place) + _cross(omega, _cross(omega, place))
    force, torque = _wrench(omega @ turn, alpha @ turn, rise @ turn)
    force, torque = turn @ force, turn @ torque
    return force, torque + _cross_matrix(place) @ force


def parameters_of_links(robot: Articulated) -> np.ndarray:
    """The φ of the arm's links, [10n]."""
    each = zip(np.asarray(robot.masses), np.asarray(robot.centers), np.asarray(robot.inertias), strict=True)
    return np.concatenate([parameters_of_body(float(mass), center, inertia) for mass, center, inertia in each])


def parameters_of_payload(payload: Payload) -> np.ndarray:
    """The φ of what a tip carries, [10].

    - `payload`: in the tip's frame.
    """
    return parameters_of_body(float(payload.mass), np.asarray(payload.center), np.asarray(payload.inertia))


def parameters_of_body(mass: float, center: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Mass, mass times centre, and the inertia about the origin, [10].

    - `mass`: kg.
    - `center`: [3], m.
    - `inertia`: about the centre of mass [3 3], kg m².
    """
    about = inertia + mass * (center @ center * np.eye(3) - np.outer(center, center))
    return np.concatenate([[mass], mass * center, [about[pair] for pair in PAIRS]])


def body_of_parameters(phi: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass [kg], centre [3, m] and inertia about the centre [3 3, kg m²] of a body; without mass all of it is 0.

    - `phi`: [10].
    """
    mass = float(phi[0])
    if mass <= 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    center = phi[1:4] / mass
    about = symmetric_matrix(phi[4:])
    return mass, center, about - mass * (center @ center * np.eye(3) - np.outer(center, center))


def symmetric_matrix(entries: np.ndarray) -> np.ndarray:
    """The symmetric matrix of xx, yy, zz, xy, xz, yz, [3 3].

    - `entries`: [6].
    """
    matrix = np.empty((3, 3))
    for entry, (i, j) in zip(entries, PAIRS, strict=True):
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def _links(robot: Articulated, motion: JointMotion) -> LinkMotion:
    k, n = motion.q.shape
    links = LinkMotion(np.empty((n, k, 3, 3)), *(np.empty((n, k, 3)) for _ in range(4)))
    # As plain numbers: JAX would dispatch each index.
    gravity, turns_of, shifts = map(np.asarray, (robot.gravity_vector, robot.rotations, robot.translations))
    z = np.array([0.0, 0.0, 1.0])
    for i, parent in enumerate(robot.parents):
        turns = robot.joint_units[i] == "rad"
        turn, shift = turns_of[i], shifts[i]
        q, dq, ddq = motion.q[:, i], motion.dq[:, i, None], motion.ddq[:, i, None]
        local = turn @ _about_z(q) if turns else np.broadcast_to(turn, (k, 3, 3))
        offset = np.broadcast_to(shift, (k, 3)) if turns else shift + q[:, None] * turn[:, 2]
        if parent < 0:
            before, at = np.eye(3), np.zeros(3)
            omega, alpha, rise = np.zeros((k, 3)), np.zeros((k, 3)), np.broadcast_to(-gravity, (k, 3))
        else:
            before, at = links.rotation[parent], links.place[parent]
            omega, alpha, rise = links.omega[parent], links.alpha[parent], links.rise[parent]
        links.rotation[i] = before @ local
        links.place[i] = at + np.einsum("...ij,...j->...i", before, offset)
        moved = rise + _cross(alpha, offset) + _cross(omega, _cross(omega, offset))
        omega, alpha, moved = (np.einsum("kji,kj->ki", local, v) for v in (omega, alpha, moved))
        if turns:
            links.omega[i] = omega + dq * z
            links.alpha[i] = alpha + ddq * z + _cross(omega, dq * z)
            links.rise[i] = moved
        else:
            links.omega[i], links.alpha[i] = omega, alpha
            links.rise[i] = moved + ddq * z + 2.0 * _cross(omega, dq * z)
    return links


def _about_z(q: np.ndarray) -> np.ndarray:
    turned = np.zeros((len(q), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(q)
    turned[:, 1, 0] = np.sin(q)
    turned[:, 0, 1] = -turned[:, 1, 0]
    turned[:, 2, 2] = 1.0
    return turned


def _wrench(omega: np.ndarray, alpha: np.ndarray, rise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque about the frame's origin that move a body, both [k 3 10]: they times φ are numbers."""
    k = len(omega)
    w, dw = _cross_matrix(omega), _cross_matrix(alpha)
    force, torque = np.zeros((k, 3, BODY)), np.zeros((k, 3, BODY))
    force[:, :, 0] = rise
    force[:, :, 1:4] = dw + w @ w
    torque[:, :, 1:4] = -_cross_matrix(rise)
    torque[:, :, 4:] = _times_inertia(alpha) + w @ _times_inertia(omega)
    return force, torque


def _times_inertia(v: np.ndarray) -> np.ndarray:
    """The matrix that makes `I v` of the six entries of I, [k 3 6]."""
    matrix = np.zeros((len(v), 3, 6))
    for column, (i, j) in enumerate(PAIRS):
        matrix[:, i, column] = v[:, j]
        matrix[:, j, column] = v[:, i]
    return matrix


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """As NumPy's, in a third of the time for so few numbers."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return product


def _cross_matrix(v: np.ndarray) -> np.ndarray:
    matrix = np.zeros((*v.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., i, j], matrix[..., j, i] = -v[..., k], v[..., k]
    return matrix


def _onto_joints(
    columns: np.ndarray, robot: Articulated, links: LinkMotion, body: int, force: np.ndarray, torque: np.ndarray
) -> None:
    """Writes what each joint that carries the body feels of a wrench in its frame's axes and about its origin."""
    joint = body
    rotation = links.rotation[body]
    while joint >= 0:
        axis = np.einsum("kji,kj->ki", rotation, links.rotation[joint][:, :, 2])
        if robot.joint_units[joint] == "rad":
            arm = np.einsum("kji,kj->ki", rotation, links.place[body] - links.place[joint])
            # z · (n + r × f) = z · n + (z × r) · f
            lever = _cross(axis, arm)
            columns[:, joint] = np.einsum("ki,kic->kc", axis, torque) + np.einsum("ki,kic->kc", lever, force)
        else:
            columns[:, joint] = np.einsum("ki,kic->kc", axis, force)
        joint = robot.parents[joint]
