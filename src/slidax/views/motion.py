"""Poses of the true arm and of the reference at the frames of a replay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError, counted
from slidax._names import quoted
from slidax.figures.logged import log_of
from slidax.simulation import Log, Run

from .skeleton import Poses, Skeleton

LARGEST = 1e6
"""Larger positions or torques, in any unit, are not drawn."""


@dataclass(frozen=True)
class SampledRun:
    """A run at the frames of a replay.

    - `t`: evenly spaced times [k], s.
    - `actual_tip`, `desired_tip`: tip positions [k 3], m.
    - `travel`: largest distance of each joint from 0 [n], rad or m.
    """

    t: np.ndarray
    actual: Poses
    desired: Poses
    actual_tip: np.ndarray
    desired_tip: np.ndarray
    travel: np.ndarray

    def frame(self, t: float) -> int:
        """Number of the frame nearest to time `t` [s]."""
        share = (t - self.t[0]) / (self.t[-1] - self.t[0])
        return int(np.clip(np.rint(share * (len(self.t) - 1)), 0, len(self.t) - 1))


def sample_run(run: Run, skeleton: Skeleton, rate: float, most: int) -> SampledRun:
    """Interpolate the log of a run linearly in joint space.

    - `run`: with a log.
    - `skeleton`: of its robot.
    - `rate`: frames per second of the run, > 0.
    - `most`: frames at most; a longer run has fewer per second.

    Raises DefinitionError if the run has no log, or the robot has other joints.
    """
    log = log_of(run)
    q, desired = np.asarray(log.state.q), np.asarray(log.reference.q)
    if q.shape[1] != skeleton.joints:
        raise DefinitionError(
            f"the run has {counted(q.shape[1], 'joint')}, but this robot has {skeleton.joints}: give the run's robot"
        )
    names = skeleton.names
    if tuple(names) != tuple(run.joint_names) and set(names) == set(run.joint_names):
        raise DefinitionError(
            f"the run's joints are {quoted(run.joint_names)}, but this robot's are {quoted(names)}: give the run's "
            "robot"
        )
    valid = valid_samples(log)
    t, q, desired = np.asarray(log.t)[valid], q[valid], desired[valid]
    if len(t) < 2:
        raise DefinitionError("this run ended before its second logged sample, so there is nothing to replay")
    frames = int(np.clip(np.ceil((t[-1] - t[0]) * rate - 1e-6) + 1, 2, most))
    times = np.linspace(t[0], t[-1], frames)
    actual, ideal = (skeleton.poses(_at(times, t, positions)) for positions in (q, desired))
    travel = np.maximum(np.abs(q).max(axis=0), np.abs(desired).max(axis=0))
    return SampledRun(times, actual, ideal, skeleton.tips(actual), skeleton.tips(ideal), travel)


def valid_samples(log: Log) -> np.ndarray:
    """True for each sample of a `log` that can be drawn [k]; a failed run may end in huge or non-finite values."""
    values = np.concatenate([np.asarray(part) for part in (log.state.q, log.reference.q, log.tau)], axis=1)
    with np.errstate(invalid="ignore"):
        return (np.abs(values) < LARGEST).all(axis=1)


def _at(times: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)
