"""A run as a film: where the arm was, and where it should have been, at evenly spaced times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError, counted
from slidax._names import quoted
from slidax.figures.logged import log_of
from slidax.simulation import Log, Run

from .skeleton import Poses, Skeleton

LARGEST = 1e6
"""What no joint and no torque of an arm reaches, in any unit."""


@dataclass(frozen=True)
class Motion:
    """The frames of a film.

    - `t`: their times [k], s.
    - `actual`, `desired`: the poses of the true arm and of the reference.
    - `actual_tip`, `desired_tip`: places of the tips [k 3], m.
    - `travel`: how far each joint goes from 0 [n], rad or m.
    """

    t: np.ndarray
    actual: Poses
    desired: Poses
    actual_tip: np.ndarray
    desired_tip: np.ndarray
    travel: np.ndarray

    def frame(self, t: float) -> int:
        """The number of the frame nearest to a time.

        - `t`: s; before the first and after the last frame these are meant.
        """
        share = (t - self.t[0]) / (self.t[-1] - self.t[0])
        return int(np.clip(np.rint(share * (len(self.t) - 1)), 0, len(self.t) - 1))


def motion(run: Run, skeleton: Skeleton, rate: float, most: int) -> Motion:
    """The film of a run, straight lines in the joints between its logged samples.

    - `run`: a finished run with a log.
    - `skeleton`: of its robot.
    - `rate`: frames per second of the run, > 0.
    - `most`: frames of the film; where the run is longer, there are fewer per second.

    Raises DefinitionError if the run has no log, or the robot another number of joints.
    """
    log = log_of(run)
    q, desired = np.asarray(log.state.q), np.asarray(log.reference.q)
    if q.shape[1] != skeleton.joints:
        raise DefinitionError(
            f"the run has {counted(q.shape[1], 'joint')}, but this robot has {skeleton.joints}; give its own"
        )
    names = skeleton.names
    if tuple(names) != tuple(run.joint_names) and set(names) == set(run.joint_names):
        raise DefinitionError(
            f"the run's joints are {quoted(run.joint_names)}, but this robot's order is {quoted(names)}; give its own"
        )
    good = sound_samples(log)
    t, q, desired = np.asarray(log.t)[good], q[good], desired[good]
    if len(t) < 2:
        raise DefinitionError("this run ended before its second logged sample: there is nothing to see")
    frames = int(np.clip(np.ceil((t[-1] - t[0]) * rate - 1e-6) + 1, 2, most))
    times = np.linspace(t[0], t[-1], frames)
    actual, ideal = (skeleton.poses(_at(times, t, positions)) for positions in (q, desired))
    travel = np.maximum(np.abs(q).max(axis=0), np.abs(desired).max(axis=0))
    return Motion(times, actual, ideal, skeleton.tips(actual), skeleton.tips(ideal), travel)


def sound_samples(log: Log) -> np.ndarray:
    """Whether each sample can be shown [k]: a run that failed may end in numbers that are none, or beyond any arm.

    - `log`: of a run.
    """
    shown = np.concatenate([np.asarray(part) for part in (log.state.q, log.reference.q, log.tau)], axis=1)
    with np.errstate(invalid="ignore"):
        sound: np.ndarray = (np.abs(shown) < LARGEST).all(axis=1)
    return sound


def _at(times: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(times, t, column) for column in values.T], axis=1)
