"""Comparison of a log's torques with an arm, within physical bounds of the arm's parameters."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import numpy as np
from scipy import linalg, optimize

from slidax.arms.articulated import Articulated
from slidax.core.errors import as_array

from .logs import JointLog
from .regressor import (
    BODY,
    JointMotion,
    links_regressor,
    parameters_of_body,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from .signals import LogSignals

ROWS = 240
"""Number of times at which torques are compared: enough for about fifty parameters."""

BAND = 5.0
"""Upper end of the band in which torques are compared [Hz]: arms move in this band, and links and gears are rigid."""

FEW_COUNT = 0.2
"""A joint that slides in fewer than this share of the rows is compared in all rows."""

FLOOR = 0.03
"""Residual, as a share of the torque, below which a smaller one does not count as better."""


@dataclass(frozen=True, eq=False)
class TorqueSample:
    """A log at a few times, for the comparison with an arm.

    - `t`: times [m], s.
    - `motion`: positions, velocities, accelerations, filtered like the torques [m n].
    - `direction`: filtered sign of the velocities, the regressor of Coulomb friction [m n].
    - `tau`: filtered torques [m n].
    - `counts`: False near standstill, where dry friction takes any value [m n].
    - `size`: standard deviation of the torques [n].
    - `noise`: standard deviation of the torques' noise below the filter's cut-off frequency [n].
    """

    t: np.ndarray
    motion: JointMotion
    direction: np.ndarray
    tau: np.ndarray
    counts: np.ndarray
    size: np.ndarray
    noise: np.ndarray

    @cached_property
    def floor(self) -> np.ndarray:
        """Smallest residual that can be distinguished from 0, as a share of the torque [n]."""
        return np.clip(self.noise / self.size, FLOOR, 1.0)

    def with_torques(self, order: np.ndarray, factor: np.ndarray) -> TorqueSample:
        """Return the sample with each joint's torque taken from another column, times a factor.

        - `order`: for each joint, the column with its torque [n].
        - `factor`: for each joint, the factor of its torque [n].
        """
        size = np.abs(factor)
        return replace(
            self,
            tau=self.tau[:, order] * factor,
            size=self.size[order] * size,
            noise=self.noise[order] * size,
        )

    def with_positions(self, order: np.ndarray, factor: np.ndarray, offset: np.ndarray) -> TorqueSample:
        """Return the sample with each joint's motion taken from another column, times a factor, plus an offset.

        - `order`: for each joint, the column with its position [n].
        - `factor`, `offset`: for each joint, the factor and offset of its position [n].
        """
        q, dq, ddq = (values[:, order] * factor for values in self.motion)
        direction = self.direction[:, order] * np.sign(factor)
        return replace(self, motion=JointMotion(q + offset, dq, ddq), direction=direction, counts=self.counts[:, order])

    def only(self, joint: int, column: int) -> TorqueSample:
        """Return the sample of a single joint, with its torque from a column.

        - `column`: index of the torque's column.
        """
        own = slice(joint, joint + 1)
        return TorqueSample(
            t=self.t,
            motion=JointMotion(*(values[:, own] for values in self.motion)),
            direction=self.direction[:, own],
            tau=self.tau[:, column : column + 1],
            counts=self.counts[:, own],
            size=self.size[column : column + 1],
            noise=self.noise[column : column + 1],
        )


def sample_of(signals: LogSignals, counts: np.ndarray) -> TorqueSample:
    """Return the sample of a log at times that are spread evenly over its usable rows.

    - `counts`: True for rows and joints whose equations are used [k n].
    """
    rows = np.nonzero(signals.inner & counts.any(axis=1))[0]
    rows = rows if len(rows) else np.nonzero(signals.inner)[0]
    rows = np.unique(rows[np.linspace(0, len(rows) - 1, ROWS).astype(int)])
    tau = signals.filtered(signals.tau)
    size = np.std(tau[signals.inner], axis=0) + 1e-12
    return TorqueSample(
        t=signals.t[rows],
        motion=JointMotion(*(signals.filtered(values)[rows] for values in signals.motion)),
        direction=signals.filtered(np.sign(signals.motion.dq))[rows],
        tau=tau[rows],
        counts=np.where(counts[rows].mean(axis=0) > FEW_COUNT, counts[rows], True),
        size=size,
        noise=signals.torque_noise(),
    )


REACH = 0.2
"""Distance of a payload's mass from the tip along each axis [m]."""

LEAST_SHARE = 0.4
"""Lower bound of a link's mass, as a share of its mass in the file."""

SPREAD = 0.3
"""Prior standard deviation of a link's mass, as a share of its mass in the file."""

PAYLOAD = 0.5
"""Prior standard deviation of the payload's mass, as a share of the arm's mass."""

DRIVE = 3.0
"""Prior standard deviation of a drive's torque, as a multiple of the torque that its joint needs."""

LIMIT_SHARE = 0.02
"""Share of the torque limit that is added to the links' torque, for friction, in the torque that a joint needs."""

STIFFNESS = 2.0
"""Weight of the prior, relative to a row with a residual as large as the torque."""

COSTLY = 60.0
"""Cost of the prior that raises the score by 1, as much as a 2.7 times larger error in one joint."""


@dataclass(frozen=True, eq=False)
class TorqueMatch:
    """Match of an arm's torques with those of a sample.

    - `errors`: residual of each joint, as a share of the torque's standard deviation [n].
    - `floor`: the sample's `floor`, the smallest residual that can be distinguished from 0 [n].
    - `cost`: weighted sum of squared deviations of link masses, payload and drives from their prior. A cost of 1 weighs
      as much as the residual of one sample that is as large as the torque's standard deviation.
    """

    errors: np.ndarray
    floor: np.ndarray
    cost: float

    @property
    def score(self) -> float:
        """Sum of the logarithms of the joints' errors plus the cost of the prior; smaller is better."""
        # Below the floor an error is only noise.
        misfit = np.sum(np.log(np.clip(self.errors, self.floor, 10.0)) - np.log(self.floor))
        return float(misfit) + self.cost / COSTLY

    @property
    def explained(self) -> float:
        """Share of the torque's power that the arm explains, averaged over the joints."""
        return float(np.mean(np.clip(1.0 - self.errors**2, 0.0, 1.0)))


def match_torques(robot: Articulated, sample: TorqueSample) -> TorqueMatch:
    """Fit the arm's torques to a log's within physical bounds: masses, rotor inertias and friction are not negative.

    The unknowns are each link's mass (prior: the mass in the file), a payload (as masses at points of a box about
    the tip), rotors, friction and offsets. The torque is linear in all of them: nonnegative least squares.
    """
    return match_rigid_torques(rigid_torques(robot, sample.motion), sample)


@dataclass(frozen=True, eq=False)
class RigidTorques:
    """Torques of an arm's bodies for a motion.

    - `columns`: torque of each link, and of 1 kg at each of 21 points about the tip (`UNIT_MASSES`) [m n l], with
      l = links + 21.
    - `known`: torque of the payload in the arm's description [m n].
    - `needed`: typical torque of each joint [n], from which the prior of the drives' parameters follows: root mean
      square of the links' torque, plus a share of the torque limit for friction.
    - `mass`: mass of all links, kg.
    """

    columns: np.ndarray
    known: np.ndarray
    needed: np.ndarray
    mass: float

    @property
    def links(self) -> int:
        """The number of links."""
        return int(self.columns.shape[2]) - len(UNIT_MASSES)

    @property
    def total(self) -> np.ndarray:
        """The torque of links and payload according to the arm's description [m n]."""
        return self.columns[:, :, : self.links].sum(axis=2) + self.known

    def only(self, joint: int) -> RigidTorques:
        """Return the torques of a single joint.

        - `joint`: index of the joint.
        """
        own = slice(joint, joint + 1)
        return RigidTorques(self.columns[:, own], self.known[:, own], self.needed[own], self.mass)


def rigid_torques(robot: Articulated, motion: JointMotion) -> RigidTorques:
    """Return the torques of an arm's links and payload.

    - `motion`: the motion at m times.
    """
    n = robot.joints
    link_parameters = parameters_of_links(robot).reshape(n, BODY)
    regressor = links_regressor(robot, motion).reshape(len(motion.q), n, n, BODY)
    links = np.einsum("kilb,lb->kil", regressor, link_parameters)
    carried = payload_regressor(robot, motion)
    size = np.sqrt(np.mean(links.sum(axis=2) ** 2, axis=0))
    limit = np.asarray(robot.limits.torque)
    needed = size + np.where(np.isfinite(limit), LIMIT_SHARE * limit, LIMIT_SHARE * 10.0 * size.mean()) + 1e-9
    return RigidTorques(
        columns=np.concatenate([links, carried @ UNIT_MASSES.T], axis=2),
        known=carried @ parameters_of_payload(robot.payload),
        needed=needed,
        mass=float(np.sum(robot.masses)),
    )


def match_rigid_torques(rigid: RigidTorques, sample: TorqueSample) -> TorqueMatch:
    """Fit the arm's torques to a log's as `match_torques` does, with rigid-body torques that are already computed.

    - `rigid`: torques of the arm's bodies for the sample's motion.
    """
    columns, known, links = rigid.columns, rigid.known, rigid.links
    m, n = sample.tau.shape
    regressor = np.concatenate([columns, drive_columns(sample)], axis=2)
    believed = np.zeros(regressor.shape[2])
    believed[:links] = 1.0 - LEAST_SHARE
    target = sample.tau - known - LEAST_SHARE * columns[:, :, :links].sum(axis=2)
    weight = sample.counts / sample.size
    a = (regressor * weight[:, :, None]).reshape(m * n, -1)
    b = (target * weight).ravel()
    # Prior of a drive's torque: a few times the torque that the links need.
    drives = regressor[:, :, links + len(UNIT_MASSES) :]
    typical = np.sqrt(np.mean(np.sum(drives, axis=1) ** 2, axis=0)) / np.tile(rigid.needed, drives.shape[2] // n)
    mass = np.full(len(UNIT_MASSES), PAYLOAD * max(rigid.mass, 0.1))
    spread = np.concatenate([np.full(links, SPREAD), mass, DRIVE / (typical + 1e-12)])
    prior = STIFFNESS / spread
    solution = nonnegative(a, b, prior, believed)
    residual = (b - a @ solution).reshape(m, n)
    used = np.maximum(sample.counts.sum(axis=0), 1)
    errors = np.sqrt(np.sum(residual**2, axis=0) / used)
    return TorqueMatch(errors, sample.floor, float(np.sum((prior * (solution - believed)) ** 2)))


def drive_columns(sample: TorqueSample) -> np.ndarray:
    """Return the regressor of rotors, Coulomb and viscous friction, and positive and negative offsets, [m n 5n]."""
    constant = np.ones_like(sample.direction)
    drives = [sample.motion.ddq, sample.direction, sample.motion.dq, constant, -constant]
    return np.concatenate([values[:, :, None] * np.eye(constant.shape[1]) for values in drives], axis=2)


def nonnegative(
    a: np.ndarray, b: np.ndarray, prior: np.ndarray | None = None, believed: np.ndarray | None = None
) -> np.ndarray:
    """Return the x >= 0 that minimises `|a x - b|² + |prior (x - believed)|²`.

    - `a`, `b`: regressor and target of the equations.
    - `prior`, `believed`: weight and mean of each unknown's prior; no prior by default.
    """
    # Without BLAS: starting its threads would take longer than the products.
    gram, right = np.einsum("ki,kj->ij", a, a), np.einsum("ki,k->i", a, b)
    if prior is not None and believed is not None:
        gram[np.diag_indices_from(gram)] += prior**2
        right = right + prior**2 * believed
    size = np.sqrt(np.diag(gram)) + 1e-150
    # Scaled to a diagonal of 1; a tiny addition to it makes the matrix positive definite.
    gram = gram / np.outer(size, size)
    gram[np.diag_indices_from(gram)] += 1e-9
    factor = np.linalg.cholesky(gram).T
    target = linalg.solve_triangular(factor, right / size, trans="T")
    try:
        solution = optimize.nnls(factor, target, maxiter=20 * len(size))[0]
    except RuntimeError:
        # NNLS can cycle because of rounding; bounded least squares terminates.
        solution = optimize.lsq_linear(factor, target, (0.0, np.inf), max_iter=100).x
    return np.asarray(solution) / size


def with_gravity(robot: Articulated, gravity: np.ndarray) -> Articulated:
    """Return the arm with another gravity vector in its base frame.

    - `gravity`: acceleration [3], m/s².
    """
    return eqx.tree_at(lambda arm: arm.gravity_vector, robot, as_array(gravity))


def gravity_direction(robots: Sequence[Articulated], samples: Sequence[TorqueSample]) -> np.ndarray | None:
    """Return gravity in the direction that fits the torques best, [3], m/s²; None if no torque depends on gravity.

    The magnitude is that of the arm's gravity, or 9.81 m/s² if that is 0.

    - `robots`: the arm with the load of each sample.
    """
    strength = float(np.linalg.norm(np.asarray(robots[0].gravity_vector))) or 9.81
    rows, rights, sizes = [], [], []
    for robot, sample in zip(robots, samples, strict=True):

        def torque(gravity: np.ndarray, robot: Articulated = robot, sample: TorqueSample = sample) -> np.ndarray:
            return rigid_torques(with_gravity(robot, gravity), sample.motion).total

        still = torque(np.zeros(3))
        each = np.stack([torque(axis) - still for axis in np.eye(3)], axis=2)
        weight = sample.counts / sample.size
        columns = np.concatenate([each, -each, drive_columns(sample)], axis=2) * weight[:, :, None]
        rows.append(columns.reshape(-1, columns.shape[2]))
        rights.append(((sample.tau - still) * weight).ravel())
        sizes.append(np.linalg.norm(each, axis=(0, 1)))
    solution = nonnegative(np.concatenate(rows), np.concatenate(rights))
    # Along an axis without gravity torques, the columns are rounding errors.
    felt = np.max(sizes, axis=0) > 1e-6 * np.max(sizes)
    direction = np.where(felt, solution[:3] - solution[3:6], 0.0)
    if not felt.any() or not direction.any():
        return None

    def score(vector: np.ndarray) -> float:
        gravity = strength * vector / (np.linalg.norm(vector) + 1e-12)
        matches = zip(robots, samples, strict=True)
        return sum(match_torques(with_gravity(robot, gravity), sample).score for robot, sample in matches)

    around = [np.array(signs) * felt for signs in itertools.product((-1.0, 0.0, 1.0), repeat=3)]
    starts = [direction, *(vector for vector in around if vector.any()), np.asarray(robots[0].gravity_vector)]
    start = min(starts, key=score)
    start = start / np.linalg.norm(start)
    best = optimize.minimize(score, start, method="Nelder-Mead", options={"maxfev": 80, "xatol": 1e-3}).x
    return np.asarray(strength * best / np.linalg.norm(best))


def with_gravity_torques(log: JointLog, robot: Articulated) -> JointLog:
    """Return the log with the gravity torques of the arm's description added to its torques."""
    still = JointMotion(log.q, np.zeros_like(log.q), np.zeros_like(log.q))
    gravity = rigid_torque(robot, still, parameters_of_links(robot), parameters_of_payload(robot.payload))
    return replace(log, tau=log.tau + gravity)


def _unit_masses() -> np.ndarray:
    """Return the inertial parameters of 1 kg at the tip, at each corner of a box about it, and on its axes, [21 10].

    A compact payload is a sum of these point masses. With points on the axes, the sum has nearly the payload's inertia;
    with corners alone it would have the inertia of a body as large as the box.
    """
    points = REACH * np.array([*itertools.product((-1.0, 1.0), repeat=3), *np.eye(3), *-np.eye(3)])
    points = np.stack([np.zeros(3), *points, *(0.5 * points[8:])])
    return np.stack([parameters_of_body(1.0, point, np.zeros((3, 3))) for point in points])


UNIT_MASSES = _unit_masses()
