"""Logs of one arm for a combined fit: each with its load, checked, cut at its gaps, and filtered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import equinox as eqx
import numpy as np

from slidax.arms.arm import Payload
from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, as_array, count_noun, parse_number, short_repr

from .checks import find_usable_torques
from .identified_arm import LogFit
from .log_checks import LogPieces, cut_at_gaps, remove_outliers, require_radians
from .log_files import read_log
from .logs import Conventions, JointLog
from .regressor import parameters_of_payload, symmetric_matrix
from .signals import LogSignals, signals_of
from .torque_model import BAND, with_gravity_torques

SETTLINGS = 4
"""Least length of the fitted part after removal of the filter's settling time at each end, in settling times."""

FORM = "none, unknown, or KG@X,Y,Z, such as 2.0@0,0,0.1: mass [kg] and centre of mass in the tip's frame [m]"


def parse_load(text: str) -> Payload | None:
    """Return the load in a text: `none`, `unknown` (None), `KG`, `KG@X,Y,Z` or `KG@X,Y,Z@INERTIA`.

    - `text`: mass [kg], centre of mass in the tip's frame [m], and inertia about the centre [kg m²], as one number for
      a ball or as xx, yy, zz, xy, xz, yz.

    Raises DefinitionError for another form.
    """
    if text == "unknown":
        return None
    if text == "none":
        return Payload()
    try:
        parts = [[parse_number(word) for word in part.split(",")] for part in text.split("@")]
        if [len(part) for part in parts] not in ([1], [1, 3], [1, 3, 1], [1, 3, 6]):
            raise ValueError
    except ValueError:
        raise DefinitionError(f"`--load` takes {FORM}; got {short_repr(text)}") from None
    (mass,), center, inertia = [*parts, *([0.0, 0.0, 0.0], [0.0])[len(parts) - 1 :]]
    moments = inertia[0] * np.eye(3) if len(inertia) == 1 else symmetric_matrix(np.array(inertia))
    return Payload(mass=as_array(mass), center=as_array(center), inertia=as_array(moments))


def has_known_difference(loads: Sequence[Payload | None]) -> bool:
    """True if two known loads differ in mass or in mass times centre, so that they set the scale of an actuator map.

    - `loads`: load of each log; None if it is unknown.
    """
    known = [parameters_of_payload(load)[:4] for load in loads if load is not None]
    return any((moments != known[0]).any() for moments in known)


@dataclass(frozen=True, eq=False)
class LogRecord:
    """A log with its load, after the checks of its times, positions and torques.

    - `pieces`: the log, cut at its gaps.
    - `robot`: the arm with the log's load, as far as known.
    - `usable`: True for joints whose torques are used [n].
    - `signals`: the filtered signals.
    - `slow`: signals in a band in which links and gears are rigid, to compare their torques with the arm's.
    - `held_out`: share at the end that is predicted and not fitted.
    - `warnings`: sentences on what was left out.
    """

    pieces: LogPieces
    robot: Articulated
    usable: np.ndarray
    signals: LogSignals
    slow: LogSignals
    held_out: float
    warnings: tuple[str, ...]

    @property
    def log(self) -> JointLog:
        """The samples that are used."""
        return self.pieces.log

    @property
    def split(self) -> int:
        """First row of the held-out part."""
        return int((1.0 - self.held_out) * len(self.signals.t))

    @property
    def fitted(self) -> LogSignals:
        """The signals of the fitted part."""
        return self.signals.part(slice(0, self.split))

    def narrowed(self, band: float) -> LogRecord:
        """Return the record with its signals filtered to a narrower band.

        The record keeps its present filter if that is hardly wider, or if the log is too short for the narrower one.

        - `band`: cut-off frequency of the narrower filter [Hz].
        """
        if band >= 0.8 * self.signals.cut_off:
            return self
        narrow = replace(self, signals=signals_of(self.pieces, self.robot, band))
        # A short log keeps its wider band: the noise there widens the intervals.
        return self if narrow.shortage() else narrow

    def shortage(self) -> str:
        """Return a sentence if too few samples remain without the filter's settling time, else an empty text."""
        signals = self.signals
        row, settled, rate = np.arange(len(signals.t)), signals.settled, signals.rate
        within = f" in {len(signals.pieces)} parts without a gap" if len(signals.pieces) > 1 else ""
        parts = (("fitted", row < self.split, SETTLINGS * settled), ("held out", row >= self.split, settled // 2))
        for name, rows, fewest in parts:
            count = int(np.sum(signals.inner & rows))
            if count < fewest:
                return (
                    f"{self.log.source} is too short, {len(row) / rate:.3g} s{within}: the part that is {name} has "
                    f"{count / rate:.3g} s and needs {fewest / rate:.3g} s, without the filter's settling time, "
                    f"{settled / rate:.3g} s at each end for {signals.cut_off:.3g} Hz; `--held-out` sets the parts, "
                    "`--cut-off` the filter"
                )
        return ""

    def fit(self, torque: np.ndarray, lag: float, lag_error: float) -> LogFit:
        """Return the log with its filtered measured and predicted torques, and the errors of this prediction.

        - `torque`: torques of the identified arm for the log's motion [k n].
        - `lag`, `lag_error`: delay of the log's torques after its positions, and its standard error [s].
        """
        signals = self.signals
        predicted = signals.filtered(torque - lag * signals.slope(torque))
        measured = signals.filtered(signals.tau)
        error, fitted = measured - predicted, np.arange(len(torque)) < self.split
        rms = (_rms(error[signals.inner & fitted]), _rms(error[signals.inner & ~fitted]), _rms(measured))
        return LogFit(self.log, signals.cut_off, lag, lag_error, signals.t, measured, predicted, self.split, *rms)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


def record_of(
    log: JointLog,
    robot: Articulated,
    conventions: Conventions,
    load: Payload | None,
    cut_off: float | None,
    held_out: float,
) -> LogRecord:
    """Convert a log to the arm's conventions, check it, and filter it.

    - `log`: the log as read.
    - `load`: the load in addition to the arm's own payload; None if it is unknown.
    - `cut_off`: cut-off frequency of the regression's low-pass filter [Hz]; None to choose it from the data.
    - `held_out`: share at the end that is predicted and not fitted.

    Raises DefinitionError if the log cannot be used.
    """
    if len(log.joints) != robot.joints:
        raise DefinitionError(
            f"{log.source} has {count_noun(len(log.joints), 'joint')}, but {robot.name} has {robot.joints}"
        )
    if load is not None and float(load.mass) > 0.0:
        robot = eqx.tree_at(lambda arm: arm.payload, robot, robot.payload.joined(load))
    log = conventions.applied(log, robot.joint_units)
    if conventions.add_gravity:
        log = with_gravity_torques(log, robot)
    usable, sentences = find_usable_torques(log, robot, conventions)
    log, more = remove_outliers(log, robot)
    require_radians(log, robot)
    pieces = cut_at_gaps(log, robot)
    signals = signals_of(pieces, robot, cut_off)
    slow = signals if signals.cut_off <= BAND else signals_of(pieces, robot, BAND)
    record = LogRecord(pieces, robot, usable, signals, slow, held_out, (*sentences, *more))
    shortage = record.shortage()
    if shortage:
        raise DefinitionError(shortage)
    return record


def read_logs(logs: Sequence[JointLog | str | Path], joints: Sequence[str]) -> list[JointLog]:
    """Return the logs, read from their files; logs with the same name get a number, for messages.

    - `logs`: logs, or paths of files.
    - `joints`: the arm's joints, in its order.
    """
    read = [log if isinstance(log, JointLog) else read_log(log, joints) for log in logs]
    names = [log.source for log in read]
    return [
        replace(log, source=f"{log.source} (log {k + 1})") if names.count(log.source) > 1 else log
        for k, log in enumerate(read)
    ]
