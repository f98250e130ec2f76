"""The torque that an arm needs for a logged motion, within physical bounds of its parameters."""

from __future__ import annotations

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
"""Times at which torques are compared: enough for some fifty parameters."""

BAND = 5.0
"""The band in which torques are compared, Hz: arms move there, and links and gears are rigid."""

FEW_COUNT = 0.2
"""A share of the rows; a joint that turns round more often is compared in all."""

FLOOR = 0.03
"""A residual, as a share of the torque, below which a model is as good as any."""


@dataclass(frozen=True, eq=False)
class TorqueSample:
    """A log at a few times, for the comparison with an arm.

    - `t`: times [m], s.
    - `motion`: positions, velocities, accelerations in the band of the equations [m n].
    - `direction`: the sign of the velocities there, as Coulomb friction has it [m n].
    - `tau`: torques there [m n].
    - `counts`: False near standstill, where dry friction takes any value [m n].
    - `size`: standard deviation of the torques [n].
    - `noise`: standard deviation of their noise in the band [n].
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
        """The least residual that counts, as a share of the torque [n]."""
        return np.clip(self.noise / self.size, FLOOR, 1.0)

    def with_torques(self, order: np.ndarray, factor: np.ndarray) -> TorqueSample:
        """The sample with each joint's torque taken from another column, times a factor.

        - `order`: the column that has each joint's torque [n].
        - `factor`: of each joint after that [n].
        """
        size = np.abs(factor)
        return replace(
            self,
            tau=self.tau[:, order] * factor,
            size=self.size[order] * size,
            noise=self.noise[order] * size,
        )

    def with_positions(self, order: np.ndarray, factor: np.ndarray, offset: np.ndarray) -> TorqueSample:
        """The sample with each joint's motion taken from another column, times a factor, with another zero.

        - `order`: the column that has each joint's position [n].
        - `factor`, `offset`: of each joint after that [n].
        """
        q, dq, ddq = (values[:, order] * factor for values in self.motion)
        direction = self.direction[:, order] * np.sign(factor)
        return replace(self, motion=JointMotion(q + offset, dq, ddq), direction=direction, counts=self.counts[:, order])

    def only(self, joint: int, column: int) -> TorqueSample:
        """The sample of one joint, with the torque of some column.

        - `column`: of the torque.
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
    """Some rows of a log, evenly over its measured part.

    - `counts`: rows and joints whose equations count [k n].
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
"""The distance of a payload's mass from the tip, along each axis [m]."""

LEAST_SHARE = 0.4
"""The least share of a link's mass in the file that it can have."""

SPREAD = 0.3
"""The standard deviation of a link's mass, as a share of that in the file."""

PAYLOAD = 0.5
"""The standard deviation of a payload's mass, as a share of the arm's."""

DRIVE = 3.0
"""The standard deviation of a drive's torque, as a multiple of the torque that links and payload need."""

LIMIT_SHARE = 0.02
"""A share of the torque limit that friction may take in any drive."""

STIFFNESS = 2.0
"""The weight of the belief, relative to that of one row with a residual as large as the torque."""

COSTLY = 60.0
"""The belief's cost, in units of one row, that counts as much as an error that is 2.7 times larger in one joint."""


@dataclass(frozen=True, eq=False)
class TorqueMatch:
    """Match of an arm's torques with those of a sample.

    - `errors`: residual of each joint, as a share of the torque's standard deviation [n].
    - `floor`: the share of noise in it [n].
    - `cost`: of the belief about links and drives, in units of one row.
    """

    errors: np.ndarray
    floor: np.ndarray
    cost: float

    @property
    def score(self) -> float:
        """The sum of the logarithms of the joints' errors, and the cost of the belief; less is better."""
        # Beyond the floor there is noise alone.
        misfit = np.sum(np.log(np.clip(self.errors, self.floor, 10.0)) - np.log(self.floor))
        return float(misfit) + self.cost / COSTLY

    @property
    def explained(self) -> float:
        """The mean share of the torque's power that the arm explains, over the joints."""
        return float(np.mean(np.clip(1.0 - self.errors**2, 0.0, 1.0)))


def match_torques(robot: Articulated, sample: TorqueSample) -> TorqueMatch:
    """The best match within physical bounds: masses, rotors and friction are not negative.

    Unknown are each link's mass (within a spread about the file's), a payload (as masses at the corners of a box about
    the tip), rotors, friction and offsets. All are linear, so this is least squares with unknowns >= 0.
    """
    return match_rigid_torques(rigid_torques(robot, sample.motion), sample)


@dataclass(frozen=True, eq=False)
class RigidTorques:
    """Torques that the bodies of an arm need for a motion.

    - `columns`: of each link, and of a payload of 1 kg in each corner [m n l].
    - `known`: of the payload in the arm's description [m n].
    - `needed`: root mean square of the links' torque, and a share of the limit that friction may take [n].
    - `mass`: of the links together, kg.
    """

    columns: np.ndarray
    known: np.ndarray
    needed: np.ndarray
    mass: float

    @property
    def links(self) -> int:
        """The number of links."""
        return int(self.columns.shape[2]) - len(CORNERS)

    @property
    def total(self) -> np.ndarray:
        """The torque by the arm's description [m n]."""
        return self.columns[:, :, : self.links].sum(axis=2) + self.known

    def only(self, joint: int) -> RigidTorques:
        """The torques of one joint.

        - `joint`: its number.
        """
        own = slice(joint, joint + 1)
        return RigidTorques(self.columns[:, own], self.known[:, own], self.needed[own], self.mass)


def rigid_torques(robot: Articulated, motion: JointMotion) -> RigidTorques:
    """The torques of an arm's links and payload.

    - `motion`: at m times.
    """
    n = robot.joints
    of_links = parameters_of_links(robot).reshape(n, BODY)
    regressor = links_regressor(robot, motion).reshape(len(motion.q), n, n, BODY)
    links = np.einsum("kilb,lb->kil", regressor, of_links)
    carried = payload_regressor(robot, motion)
    size = np.sqrt(np.mean(links.sum(axis=2) ** 2, axis=0))
    limit = np.asarray(robot.limits.torque)
    needed = size + np.where(np.isfinite(limit), LIMIT_SHARE * limit, LIMIT_SHARE * 10.0 * size.mean()) + 1e-9
    return RigidTorques(
        columns=np.concatenate([links, carried @ CORNERS.T], axis=2),
        known=carried @ parameters_of_payload(robot.payload),
        needed=needed,
        mass=float(np.sum(robot.masses)),
    )


def match_rigid_torques(rigid: RigidTorques, sample: TorqueSample) -> TorqueMatch:
    """As `matched`, with torques that are computed already.

    - `rigid`: of the arm.
    """
    columns, known, links = rigid.columns, rigid.known, rigid.links
    m, n = sample.tau.shape
    whole = np.concatenate([columns, drive_columns(sample)], axis=2)
    believed = np.zeros(whole.shape[2])
    believed[:links] = 1.0 - LEAST_SHARE
    target = sample.tau - known - LEAST_SHARE * columns[:, :, :links].sum(axis=2)
    weight = sample.counts / sample.size
    a = (whole * weight[:, :, None]).reshape(m * n, -1)
    b = (target * weight).ravel()
    # A drive is believed to add up to a few times the torque that the links need.
    drives = whole[:, :, links + len(CORNERS) :]
    typical = np.sqrt(np.mean(np.sum(drives, axis=1) ** 2, axis=0)) / np.tile(rigid.needed, drives.shape[2] // n)
    mass = np.full(len(CORNERS), PAYLOAD * max(rigid.mass, 0.1))
    spread = np.concatenate([np.full(links, SPREAD), mass, DRIVE / (typical + 1e-12)])
    prior = STIFFNESS / spread
    solution = nonnegative(a, b, prior, believed)
    residual = (b - a @ solution).reshape(m, n)
    used = np.maximum(sample.counts.sum(axis=0), 1)
    errors = np.sqrt(np.sum(residual**2, axis=0) / used)
    return TorqueMatch(errors, sample.floor, float(np.sum((prior * (solution - believed)) ** 2)))


def drive_columns(sample: TorqueSample) -> np.ndarray:
    """Torques of rotors, Coulomb and viscous friction, and offsets of both signs, per unit [m n 5n]."""
    constant = np.ones_like(sample.direction)
    drives = [sample.motion.ddq, sample.direction, sample.motion.dq, constant, -constant]
    return np.concatenate([values[:, :, None] * np.eye(constant.shape[1]) for values in drives], axis=2)


def nonnegative(
    a: np.ndarray, b: np.ndarray, prior: np.ndarray | None = None, believed: np.ndarray | None = None
) -> np.ndarray:
    """The x >= 0 of the least `|a x - b|² + |prior (x - believed)|²`.

    - `a`, `b`: of the equations.
    - `prior`, `believed`: weight and value of each x that is believed before; none if not given.
    """
    # Without BLAS, whose threads take longer to start than this takes.
    gram, right = np.einsum("ki,kj->ij", a, a), np.einsum("ki,k->i", a, b)
    if prior is not None and believed is not None:
        gram[np.diag_indices_from(gram)] += prior**2
        right = right + prior**2 * believed
    size = np.sqrt(np.diag(gram)) + 1e-150
    # In units in which the diagonal is 1, so that a tiny share of it makes the factor exist.
    gram = gram / np.outer(size, size)
    gram[np.diag_indices_from(gram)] += 1e-9
    factor = np.linalg.cholesky(gram).T
    target = linalg.solve_triangular(factor, right / size, trans="T")
    try:
        solution = optimize.nnls(factor, target, maxiter=20 * len(size))[0]
    except RuntimeError:
        # By rounding it turned in a circle; bounded least squares ends.
        solution = optimize.lsq_linear(factor, target, (0.0, np.inf), max_iter=100).x
    return np.asarray(solution) / size


def with_gravity(robot: Articulated, gravity: np.ndarray) -> Articulated:
    """The arm with another direction of gravity in its base frame.

    - `gravity`: acceleration [3], m/s².
    """
    return eqx.tree_at(lambda arm: arm.gravity_vector, robot, as_array(gravity))


def with_gravity_torques(log: JointLog, robot: Articulated) -> JointLog:
    """The log with the torques that gravity needs, by the arm's description, added to its torques."""
    still = JointMotion(log.q, np.zeros_like(log.q), np.zeros_like(log.q))
    gravity = rigid_torque(robot, still, parameters_of_links(robot), parameters_of_payload(robot.payload))
    return replace(log, tau=log.tau + gravity)


def _corners() -> np.ndarray:
    """Inertial parameters of 1 kg at the tip, and at each corner of a box about it [9 10]."""
    corners = [np.zeros(3)]
    corners += [REACH * np.array([x, y, z]) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    return np.stack([parameters_of_body(1.0, corner, np.zeros((3, 3))) for corner in corners])


CORNERS = _corners()
