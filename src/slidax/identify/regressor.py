"""The torque of a rigid arm as a regressor matrix times inertial parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slidax.arms.arm import Payload
from slidax.arms.articulated import PAIRS, Articulated

BODY = 10
"""Parameters per body: mass, mass times centre, inertia about the frame's origin as xx, yy, zz, xy, xz, yz."""


class JointMotion(NamedTuple):
    """Joint positions, velocities and accelerations over time, each [k n]."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray


class LinkMotion(NamedTuple):
    """Pose and motion of each joint's frame; velocities and accelerations in the frame's own axes.

    - `rotation`: axes in the base frame, as columns [n k 3 3].
    - `origin`: origin in the base frame [n k 3], m.
    - `omega`, `alpha`: angular velocity and acceleration [n k 3], rad/s and rad/s².
    - `acceleration`: acceleration of the origin minus gravity [n k 3], m/s².
    """

    rotation: np.ndarray
    origin: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    acceleration: np.ndarray


def links_regressor(robot: Articulated, motion: JointMotion) -> np.ndarray:
    """Return the regressor Y of the links alone, with `M(q) q̈ + C(q,q̇) q̇ + G(q) = Y φ`, [k n 10n].

    The links' inertial parameters φ are as from `parameters_of_links`.

    Newton's and Euler's equations are linear in mass, mass times centre and the inertia about a frame's origin
    (Atkeson, An and Hollerbach, *Estimation of inertial parameters of manipulator loads and links*, 1986). Y has no
    columns for rotors, friction and payload.

    - `robot`: the arm; only its geometry and gravity are used.
    - `motion`: the motion at k times.
    """
    links = _link_motion(robot, motion)
    n = robot.joints
    columns = np.zeros((len(motion.q), n, n * BODY))
    for body in range(n):
        force, torque = _wrench(links.omega[body], links.alpha[body], links.acceleration[body])
        _project_onto_joints(columns[:, :, body * BODY :][:, :, :BODY], robot, links, body, force, torque)
    return columns


def rigid_torque(robot: Articulated, motion: JointMotion, phi: np.ndarray, payload: np.ndarray) -> np.ndarray:
    """Return the torque `M(q) q̈ + C(q,q̇) q̇ + G(q)` of known bodies, without rotors, [k n].

    It equals the regressors times the parameters, but is faster to compute.

    - `robot`: the arm; only its geometry and gravity are used.
    - `motion`: the motion at k times.
    - `phi`: parameters of the links, as from `parameters_of_links` [10n].
    - `payload`: parameters of the payload, as from `parameters_of_payload` [10].
    """
    links = _link_motion(robot, motion)
    total = np.zeros((len(motion.q), robot.joints))
    column = np.zeros((len(motion.q), robot.joints, 1))
    for body in range(robot.joints):
        wrench = _wrench(links.omega[body], links.alpha[body], links.acceleration[body])
        force, torque = (part @ phi[body * BODY :][:BODY, None] for part in wrench)
        if body == robot.tip_joint:
            force, torque = (
                a + b @ payload[:, None] for a, b in zip((force, torque), _payload_wrench(robot, links), strict=True)
            )
        column[:] = 0.0
        _project_onto_joints(column, robot, links, body, force, torque)
        total += column[:, :, 0]
    return total


def payload_regressor(robot: Articulated, motion: JointMotion) -> np.ndarray:
    """Return the regressor Y of a payload, [k n 10]: it adds the torque `Y φ`, φ as from `parameters_of_payload`.

    - `robot`: the arm; only its geometry and gravity are used.
    - `motion`: the motion at k times.
    """
    links = _link_motion(robot, motion)
    columns = np.zeros((len(motion.q), robot.joints, BODY))
    _project_onto_joints(columns, robot, links, robot.tip_joint, *_payload_wrench(robot, links))
    return columns


def _payload_wrench(robot: Articulated, links: LinkMotion) -> tuple[np.ndarray, np.ndarray]:
    """Return the payload's force and torque per unit of φ, in the frame of the joint that carries the tip."""
    joint, rotation, tip = robot.tip_joint, np.asarray(robot.tip_rotation), np.asarray(robot.tip_translation)
    omega, alpha = links.omega[joint], links.alpha[joint]
    acceleration = links.acceleration[joint] + _cross(alpha, tip) + _cross(omega, _cross(omega, tip))
    force, torque = _wrench(omega @ rotation, alpha @ rotation, acceleration @ rotation)
    force, torque = rotation @ force, rotation @ torque
    return force, torque + cross_matrix(tip) @ force


def parameters_of_links(robot: Articulated) -> np.ndarray:
    """Return the inertial parameters φ of the arm's links, ten per link as from `parameters_of_body`, [10n]."""
    each = zip(np.asarray(robot.masses), np.asarray(robot.centers), np.asarray(robot.inertias), strict=True)
    return np.concatenate([parameters_of_body(float(mass), center, inertia) for mass, center, inertia in each])


def parameters_of_payload(payload: Payload) -> np.ndarray:
    """Return the inertial parameters φ of a payload, [10].

    - `payload`: payload in the tip's frame.
    """
    return parameters_of_body(float(payload.mass), np.asarray(payload.center), np.asarray(payload.inertia))


def parameters_of_body(mass: float, center: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Return a body's parameters φ [10]: mass, mass times centre, inertia about the origin as xx, yy, zz, xy, xz, yz.

    - `mass`: kg.
    - `center`: [3], m.
    - `inertia`: about the centre of mass [3 3], kg m².
    """
    about = inertia + mass * (center @ center * np.eye(3) - np.outer(center, center))
    return np.concatenate([[mass], mass * center, [about[pair] for pair in PAIRS]])


def body_of_parameters(phi: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return a body's mass [kg], centre [3], m, and inertia about the centre [3 3], kg m²; all 0 if its mass is <= 0.

    - `phi`: inertial parameters [10].
    """
    mass = float(phi[0])
    if mass <= 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    center = phi[1:4] / mass
    about = symmetric_matrix(phi[4:])
    return mass, center, about - mass * (center @ center * np.eye(3) - np.outer(center, center))


def symmetric_matrix(entries: np.ndarray) -> np.ndarray:
    """Return the symmetric matrix [3 3] with the entries xx, yy, zz, xy, xz, yz [6]."""
    matrix = np.empty((3, 3))
    for entry, (i, j) in zip(entries, PAIRS, strict=True):
        matrix[i, j] = matrix[j, i] = entry
    return matrix


def _link_motion(robot: Articulated, motion: JointMotion) -> LinkMotion:
    k, n = motion.q.shape
    links = LinkMotion(np.empty((n, k, 3, 3)), *(np.empty((n, k, 3)) for _ in range(4)))
    # As NumPy arrays: JAX would dispatch each indexing operation.
    gravity, rotations, translations = map(np.asarray, (robot.gravity_vector, robot.rotations, robot.translations))
    z = np.array([0.0, 0.0, 1.0])
    for i, parent in enumerate(robot.parents):
        revolute = robot.joint_units[i] == "rad"
        rotation, translation = rotations[i], translations[i]
        q, dq, ddq = motion.q[:, i], motion.dq[:, i, None], motion.ddq[:, i, None]
        local = rotation @ _rotation_about_z(q) if revolute else np.broadcast_to(rotation, (k, 3, 3))
        offset = np.broadcast_to(translation, (k, 3)) if revolute else translation + q[:, None] * rotation[:, 2]
        if parent < 0:
            outer, origin = np.eye(3), np.zeros(3)
            omega, alpha, acceleration = np.zeros((k, 3)), np.zeros((k, 3)), np.broadcast_to(-gravity, (k, 3))
        else:
            outer, origin = links.rotation[parent], links.origin[parent]
            omega, alpha, acceleration = links.omega[parent], links.alpha[parent], links.acceleration[parent]
        links.rotation[i] = outer @ local
        links.origin[i] = origin + np.einsum("...ij,...j->...i", outer, offset)
        acceleration = acceleration + _cross(alpha, offset) + _cross(omega, _cross(omega, offset))
        omega, alpha, acceleration = (np.einsum("kji,kj->ki", local, v) for v in (omega, alpha, acceleration))
        if revolute:
            links.omega[i] = omega + dq * z
            links.alpha[i] = alpha + ddq * z + _cross(omega, dq * z)
            links.acceleration[i] = acceleration
        else:
            links.omega[i], links.alpha[i] = omega, alpha
            links.acceleration[i] = acceleration + ddq * z + 2.0 * _cross(omega, dq * z)
    return links


def _rotation_about_z(q: np.ndarray) -> np.ndarray:
    rotation = np.zeros((len(q), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(q)
    rotation[:, 1, 0] = np.sin(q)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    rotation[:, 2, 2] = 1.0
    return rotation


def _wrench(omega: np.ndarray, alpha: np.ndarray, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the force, and the torque about the frame's origin, that move a body, per unit of φ, both [k 3 10]."""
    k = len(omega)
    w, dw = cross_matrix(omega), cross_matrix(alpha)
    force, torque = np.zeros((k, 3, BODY)), np.zeros((k, 3, BODY))
    force[:, :, 0] = acceleration
    force[:, :, 1:4] = dw + w @ w
    torque[:, :, 1:4] = -cross_matrix(acceleration)
    torque[:, :, 4:] = _times_inertia(alpha) + w @ _times_inertia(omega)
    return force, torque


def _times_inertia(v: np.ndarray) -> np.ndarray:
    """Return the matrix that maps the six entries of an inertia I to `I v`, [k 3 6]."""
    matrix = np.zeros((len(v), 3, 6))
    for column, (i, j) in enumerate(PAIRS):
        matrix[:, i, column] = v[:, j]
        matrix[:, j, column] = v[:, i]
    return matrix


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product; three times faster than NumPy's for so few entries."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return product


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """The matrix of the cross product `v × ·`, [... 3 3]."""
    matrix = np.zeros((*v.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., i, j], matrix[..., j, i] = -v[..., k], v[..., k]
    return matrix


def _project_onto_joints(
    columns: np.ndarray, robot: Articulated, links: LinkMotion, body: int, force: np.ndarray, torque: np.ndarray
) -> None:
    """Write the generalised force of a body's wrench at each joint that carries the body into `columns`."""
    joint = body
    rotation = links.rotation[body]
    while joint >= 0:
        axis = np.einsum("kji,kj->ki", rotation, links.rotation[joint][:, :, 2])
        if robot.joint_units[joint] == "rad":
            arm = np.einsum("kji,kj->ki", rotation, links.origin[body] - links.origin[joint])
            # z · (n + r × f) = z · n + (z × r) · f, with axis z, torque n, force f and lever r.
            lever = _cross(axis, arm)
            columns[:, joint] = np.einsum("ki,kic->kc", axis, torque) + np.einsum("ki,kic->kc", lever, force)
        else:
            columns[:, joint] = np.einsum("ki,kic->kc", axis, force)
        joint = robot.parents[joint]
