"""The torque that an arm needs for a logged motion, within the physical bounds of its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import numpy as np
from scipy import optimize

from slidax._errors import as_array
from slidax.robots import Articulated

from .regressor import (
    BODY,
    Motion,
    links_regressor,
    parameters_of_body,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
)
from .signals import Signals

ROWS = 240
"""Times at which torques are compared: enough for some fifty parameters."""

REACH = 0.2
"""The distance of a payload's mass from the tip, along each axis [m]."""

LEAST_SHARE = 0.4
"""The least share of a link's mass in the file that it can have."""

SPREAD = 0.3
"""The standard deviation of a link's mass, as a share of that in the file."""

STIFFNESS = 2.0
"""The weight of the belief, relative to that of one row with a residual as large as the torque."""

FLOOR = 0.03
"""A residual, as a share of the torque, below which a model is as good as any."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A log at a few times, for the comparison with an arm.

    - `motion`: positions, velocities, accelerations [m n].
    - `tau`: torques in the band of the equations [m n].
    - `counts`: False near standstill, where dry friction takes any value [m n].
    - `size`: standard deviation of the torques [n].
    - `noise`: standard deviation of their noise in the band [n].
    """

    motion: Motion
    tau: np.ndarray
    counts: np.ndarray
    size: np.ndarray
    noise: np.ndarray

    @cached_property
    def floor(self) -> np.ndarray:
        """The least residual that counts, as a share of the torque [n]."""
        floor: np.ndarray = np.clip(self.noise / self.size, FLOOR, 1.0)
        return floor

    def with_torques(self, order: np.ndarray, factor: np.ndarray) -> Sample:
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

    def with_positions(self, order: np.ndarray, factor: np.ndarray, offset: np.ndarray) -> Sample:
        """The sample with each joint's motion taken from another column, times a factor, with another zero.

        - `order`: the column that has each joint's position [n].
        - `factor`, `offset`: of each joint after that [n].
        """
        q, dq, ddq = (values[:, order] * factor for values in self.motion)
        return replace(self, motion=Motion(q + offset, dq, ddq), counts=self.counts[:, order])


def sample_of(signals: Signals, counts: np.ndarray, delay: float = 0.0) -> Sample:
    """Some rows of a log, evenly over its measured part.

    - `signals`: of the log.
    - `counts`: rows and joints whose equations count [k n].
    - `delay`: the time by which the torques are read later than the positions [s].
    """
    rows = np.nonzero(signals.inner & counts.any(axis=1))[0]
    rows = rows if len(rows) else np.nonzero(signals.inner)[0]
    rows = np.unique(rows[np.linspace(0, len(rows) - 1, ROWS).astype(int)])
    tau = signals.filtered(signals.tau)
    size = np.std(tau[signals.inner], axis=0) + 1e-12
    if delay:
        tau = np.stack([np.interp(signals.t + delay, signals.t, column) for column in tau.T], axis=1)
    f, power = signals.spectrum(signals.tau, 4.0)
    above = (f > 3.0 * signals.cut_off) & (f < 0.45 * signals.rate)
    density = np.median(power[above], axis=0) if above.sum() > 3 else np.zeros(tau.shape[1])
    return Sample(
        motion=Motion(*(values[rows] for values in signals.motion)),
        tau=tau[rows],
        counts=counts[rows],
        size=size,
        noise=np.sqrt(density * signals.cut_off),
    )


    def only(self, joint: int, column: int) -> Sample:
        """The sample of one joint, with the torque of some column.

        - `joint`: number of the joint.
        - `column`: of the torque.
        """
        own = slice(joint, joint + 1)
        return Sample(
            motion=Motion(*(values[:, own] for values in self.motion)),
            tau=self.tau[:, column : column + 1],
            counts=self.counts[:, own],
            size=self.size[column : column + 1],
            noise=self.noise[column : column + 1],
        )


@dataclass(frozen=True, eq=False)
class Match:
    """How well an arm explains the torques of a sample.

    - `errors`: residual of each joint, as a share of the torque's standard deviation [n].
    - `floor`: the share of noise in it [n].
    - `cost`: of the belief about links and drives, in units of one row.
    """

    errors: np.ndarray
    floor: np.ndarray
    cost: float

    @property
    def score(self) -> float:
        """The sum of the logarithms of the joints' errors; less is better."""
        # Beyond the floor there is noise alone.
        return float(np.sum(np.log(np.clip(self.errors, self.floor, 10.0)) - np.log(self.floor)))

    @property
    def explained(self) -> float:
        """The mean share of the torque's power that the arm explains, over the joints."""
        return float(np.mean(np.clip(1.0 - self.errors**2, 0.0, 1.0)))


def matched(robot: Articulated, sample: Sample) -> Match:
    """The best match within physical bounds: masses, rotors and friction are not negative.

    Unknown are each link's mass (within a spread about the file's), a payload (as masses at the corners of a box about
    the tip), rotors, friction and offsets. All are linear, so this is least squares with unknowns >= 0.

    - `robot`: the arm.
    - `sample`: of a log.
    """
    columns, known = rigid_columns(robot, sample.motion)
    return matched_columns(columns, known, sample)


def rigid_columns(robot: Articulated, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Torques of each link and of a payload of 1 kg in each corner [m n n + 9], and of what the tip is known to carry.

    - `robot`: the arm.
    - `motion`: at m times.
    """
    n = robot.joints
    of_links = parameters_of_links(robot).reshape(n, BODY)
    regressor = links_regressor(robot, motion).reshape(len(motion.q), n, n, BODY)
    links = np.einsum("kilb,lb->kil", regressor, of_links)
    carried = payload_regressor(robot, motion)
    known = carried @ parameters_of_payload(robot.payload)
    return np.concatenate([links, carried @ CORNERS.T], axis=2), known


def matched_columns(columns: np.ndarray, known: np.ndarray, sample: Sample) -> Match:
    """As `matched`, with the columns of `rigid_columns`.

    - `columns`, `known`: of the arm.
    - `sample`: of a log.
    """
    (m, n), links = sample.tau.shape, columns.shape[2] - len(CORNERS)
    whole = np.concatenate([columns, drive_columns(sample.motion)], axis=2)
    believed = np.zeros(whole.shape[2])
    believed[:links] = 1.0 - LEAST_SHARE
    target = sample.tau - known - LEAST_SHARE * columns[:, :, :links].sum(axis=2)
    weight = sample.counts / sample.size
    a = (whole * weight[:, :, None]).reshape(m * n, -1)
    b = (target * weight).ravel()
    # Drives cost as much as they explain of the torque, so that they explain no noise.
    typical = np.sqrt(np.mean((whole[:, :, links + len(CORNERS) :] / sample.size[:, None]) ** 2, axis=(0, 1)) * n)
    spread = np.concatenate([np.full(links, SPREAD), np.full(len(CORNERS), 3.0), 3.0 / (typical + 1e-12)])
    prior = STIFFNESS / spread
    # From the normal equations' factor, which is small.
    factor = np.linalg.qr(
        np.vstack([np.column_stack([a, b]), np.column_stack([np.diag(prior), prior * believed])]), mode="r"
    )
    size = np.sqrt(np.sum(factor[:, :-1] ** 2, axis=0)) + 1e-300
    solution = nonnegative(factor[:, :-1] / size, factor[:, -1]) / size
    residual = (b - a @ solution).reshape(m, n)
    used = np.maximum(sample.counts.sum(axis=0), 1)
    errors = np.sqrt(np.sum(residual**2, axis=0) / used)
    return Match(errors, sample.floor, float(np.sum((prior * (solution - believed)) ** 2)))


def drive_columns(motion: Motion) -> np.ndarray:
    """Torques of rotors, Coulomb and viscous friction, and offsets of both signs, per unit [m n 5n].

    - `motion`: at m times.
    """
    constant = np.ones_like(motion.dq)
    drives = [motion.ddq, np.sign(motion.dq), motion.dq, constant, -constant]
    return np.concatenate([values[:, :, None] * np.eye(motion.dq.shape[1]) for values in drives], axis=2)


def nonnegative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The x >= 0 of the least `|a x - b|`.

    - `a`, `b`: of the equations.
    """
    try:
        return np.asarray(optimize.nnls(a, b, maxiter=20 * a.shape[1])[0])
    except RuntimeError:
        # It turns in a circle by rounding: bounded least squares ends.
        return np.asarray(optimize.lsq_linear(a, b, (0.0, np.inf), max_iter=100).x)


def with_gravity(robot: Articulated, gravity: np.ndarray) -> Articulated:
    """The arm with another direction of gravity in its base frame.

    - `robot`: the arm.
    - `gravity`: acceleration [3], m/s².
    """
    turned: Articulated = eqx.tree_at(lambda arm: arm.gravity_vector, robot, as_array(gravity))
    return turned


def _corners() -> np.ndarray:
    """Inertial parameters of 1 kg at the tip, and at each corner of a box about it [9 10]."""
    corners = [np.zeros(3)]
    corners += [REACH * np.array([x, y, z]) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    return np.stack([parameters_of_body(1.0, corner, np.zeros((3, 3))) for corner in corners])


CORNERS = _corners()
