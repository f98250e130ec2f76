"""A log at a few times, for the comparison of its torques with an arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .regressor import Motion
from .signals import Signals

ROWS = 240
"""Times at which torques are compared: enough for some fifty parameters."""

BAND = 5.0
"""The band in which torques are compared, Hz: arms move there, and links and gears are rigid."""

FEW_COUNT = 0.2
"""A share of the rows; a joint that turns round more often is compared in all."""

FLOOR = 0.03
"""A residual, as a share of the torque, below which a model is as good as any."""


@dataclass(frozen=True, eq=False)
class Sample:
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
    motion: Motion
    direction: np.ndarray
    tau: np.ndarray
    counts: np.ndarray
    size: np.ndarray
    noise: np.ndarray

    @cached_property
    def floor(self) -> np.ndarray:
        """The least residual that counts, as a share of the torque [n]."""
        return np.clip(self.noise / self.size, FLOOR, 1.0)

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
        direction = self.direction[:, order] * np.sign(factor)
        return replace(self, motion=Motion(q + offset, dq, ddq), direction=direction, counts=self.counts[:, order])

    def only(self, joint: int, column: int) -> Sample:
        """The sample of one joint, with the torque of some column.

        - `column`: of the torque.
        """
        own = slice(joint, joint + 1)
        return Sample(
            t=self.t,
            motion=Motion(*(values[:, own] for values in self.motion)),
            direction=self.direction[:, own],
            tau=self.tau[:, column : column + 1],
            counts=self.counts[:, own],
            size=self.size[column : column + 1],
            noise=self.noise[column : column + 1],
        )


def sample_of(signals: Signals, counts: np.ndarray) -> Sample:
    """Some rows of a log, evenly over its measured part.

    - `counts`: rows and joints whose equations count [k n].
    """
    rows = np.nonzero(signals.inner & counts.any(axis=1))[0]
    rows = rows if len(rows) else np.nonzero(signals.inner)[0]
    rows = np.unique(rows[np.linspace(0, len(rows) - 1, ROWS).astype(int)])
    tau = signals.filtered(signals.tau)
    size = np.std(tau[signals.inner], axis=0) + 1e-12
    return Sample(
        t=signals.t[rows],
        motion=Motion(*(signals.filtered(values)[rows] for values in signals.motion)),
        direction=signals.filtered(np.sign(signals.motion.dq))[rows],
        tau=tau[rows],
        counts=np.where(counts[rows].mean(axis=0) > FEW_COUNT, counts[rows], True),
        size=size,
        noise=signals.torque_noise(),
    )
