"""Checks of a log's times, positions and velocities: units, gaps, wraps, outliers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError

from .logs import FEWEST, TIME_UNITS, JointLog

SLOWEST, FASTEST = 8.0, 50_000.0
"""Range of sampling rates [Hz]: slower logs do not show rotor inertias, and no robot's driver writes faster."""

BRIEFEST = 0.5
"""Shortest duration of a log, s."""

GAP_PERIODS, GAP_SECONDS = 5.0, 0.02
"""A time without samples is a gap if it exceeds both this number of periods and of seconds; else it is interpolated."""

FROZEN_SAMPLES, FROZEN_SECONDS = 8, 0.05
"""Torques on straight lines for at least this number of samples and of seconds, in a moving arm, were not measured."""

FAST, USUAL = 4.0, 1.0
"""An implausible and a usual speed, as multiples of a joint's speed limit."""

STILL = 2e-3
"""Share of the speed limit below which an arm stands still."""

COPIED, SAME = 50, 1e-4
"""Number of successive samples that must not occur in two parts of the logs, and the resolution of this comparison as a
share of a column's range, since a copy may have fewer digits."""


@dataclass(frozen=True, eq=False)
class LogPieces:
    """A log whose times increase, cut at its gaps.

    - `log`: the samples in order.
    - `pieces`: ranges of rows without a gap inside.
    - `warnings`: sentences on samples that were left out.
    """

    log: JointLog
    pieces: tuple[slice, ...]
    warnings: tuple[str, ...]


def require_no_copies(logs: Sequence[LogPieces]) -> None:
    """Raise DefinitionError if consecutive samples of a moving arm occur twice in the logs.

    If copied samples counted twice, the parameters' variances would be too small, by up to a factor of two.

    - `logs`: the logs of a fit, cut at their gaps.
    """
    parts = [(pieces.log, piece) for pieces in logs for piece in pieces.pieces]
    if len(parts) == 1:
        return
    rows = [np.hstack([log.q[piece], log.tau[piece]]) for log, piece in parts]
    moving = [np.append(False, np.any(np.diff(log.q[piece], axis=0) != 0.0, axis=1)) for log, piece in parts]
    part = np.repeat(np.arange(len(parts)), [len(some) for some in rows])
    values = np.concatenate(rows)
    span = np.ptp(values, axis=0)
    digits = np.round((values - values.min(axis=0)) / np.where(span > 0.0, SAME * span, 1.0)).astype(np.int32)
    _, same = np.unique(digits, axis=0, return_inverse=True)
    first, last = np.full(same.max() + 1, len(parts)), np.full(same.max() + 1, -1)
    np.minimum.at(first, same, part)
    np.maximum.at(last, same, part)
    copied = (first != last)[same] & np.concatenate(moving)
    for k, (log, piece) in enumerate(parts):
        labels, _ = ndimage.label(copied[part == k])
        sizes = np.bincount(labels)[1:]
        if sizes.size and sizes.max() >= COPIED:
            begin = int(np.argmax(labels == 1 + np.argmax(sizes)))
            there = same[part == k][begin]
            index = last[there] if first[there] == k else first[there]
            other, where = parts[index]
            at = other.t[where][np.argmax(same[part == index] == there)]
            raise DefinitionError(
                f"{np.sum(copied[part == k])} samples of {log.source}, from {log.t[piece][begin]:.4g} s on, stand in "
                f"{other.source} from {at:.4g} s on, too: the same noise would count twice, and the parameters would "
                "seem more certain than they are; leave the copy out"
            )


def cut_at_gaps(log: JointLog, robot: Articulated) -> LogPieces:
    """Check the times of a log, and cut it at its gaps.

    - `robot`: the arm, whose speed limits reveal wrong units.

    Raises DefinitionError if the times do not advance, or are not in s.
    """
    warnings: list[str] = []
    breaks = np.zeros(0, int)
    backward = np.nonzero(np.diff(log.t) < 0)[0] + 1
    if len(backward):
        log, breaks, sentence = _sort_times(log, backward)
        warnings.append(sentence)
    log, breaks, merged = _merge_equal_times(log, breaks)
    if merged:
        warnings.append(f"{merged} samples of {log.source} repeat the time of the sample before: they are averaged")
    require_seconds(log, robot)
    keep, cuts = _drop_frozen(log, breaks)
    if not keep.all():
        first = int(np.argmin(keep))
        warnings.append(
            f"torques of {log.source} repeat or follow straight lines for {log.period * (~keep).sum():.3g} s, first at "
            f"{log.t[first]:.4g} s: these samples are left out, since they were not measured"
        )
        new_row = np.cumsum(keep) - keep
        breaks = np.unique(np.concatenate([new_row[breaks], new_row[cuts]]))
        log = log.rows(keep)
    steps = np.diff(log.t)
    gaps = np.nonzero(steps > max(GAP_PERIODS * log.period, GAP_SECONDS))[0] + 1
    new = np.setdiff1d(gaps, breaks)
    if len(new):
        longest = int(new[np.argmax(steps[new - 1])])
        warnings.append(
            f"{log.source} has {_gaps(len(new))}, the longest of {steps[longest - 1]:.3g} s at "
            f"{log.t[longest - 1]:.4g} s: the parts before and after are fitted separately"
        )
    edges = np.unique(np.concatenate([[0], breaks, gaps, [len(log.t)]]).astype(int))
    pieces = [slice(a, b) for a, b in itertools.pairwise(edges.tolist()) if b > a]
    return LogPieces(log, tuple(pieces), tuple(warnings))


def require_seconds(log: JointLog, robot: Articulated) -> None:
    """Raise a DefinitionError if the times of a log are not in s.

    - `log`: a log with increasing times.
    - `robot`: the arm, whose speed limits reveal wrong units.
    """
    rate, duration, speed = 1.0 / log.period, float(np.sum(np.diff(log.t).clip(0))), share_of_speed(log, robot)

    def is_possible(unit: float) -> bool:
        return (
            SLOWEST <= rate / unit <= FASTEST
            and duration * unit >= BRIEFEST
            and STILL * USUAL <= speed / unit <= FAST * USUAL
        )

    others = _units_by_velocity(log) or [name for name, unit in TIME_UNITS.items() if name != "s" and is_possible(unit)]
    facts = f"the times of {log.source} span {duration:.4g} s with {rate:.3g} samples per second"
    remedy = " or ".join(f"`--time-unit {name}`" for name in others)
    if not SLOWEST <= rate <= FASTEST or duration < BRIEFEST:
        hint = (
            f"are they in {' or '.join(others)}? {remedy}"
            if others
            else (
                "`--time-unit` takes s, ms, us, ns, or the seconds per unit, such as 0.004 for a counter of samples at "
                "250 Hz"
            )
        )
        rule = f"at least {SLOWEST:g} and at most {FASTEST:g} samples per second, and {BRIEFEST:g} s, are needed"
        raise DefinitionError(f"{facts}: {rule}; {hint}")
    if others and not is_possible(1.0) and speed > 0.0:
        raise DefinitionError(
            f"{facts}, in which the joints move at {speed:.2g} times their speed limits: are the times in "
            f"{' or '.join(others)}? {remedy}"
        )
    if speed > 5.0 * FAST:
        raise DefinitionError(
            f"{facts}, in which the joints move at {speed:.2g} times their speed limits: check `--time-unit` and "
            "`--position-unit`"
        )


def _units_by_velocity(log: JointLog) -> list[str]:
    """Return time units other than s for which the positions' slope is the measured velocity; empty if unclear."""
    if log.dq is None or not log.dq.any():
        return []
    steps = np.diff(log.t)[:, None]
    slope, between = np.diff(log.q, axis=0) / steps, 0.5 * (log.dq[1:] + log.dq[:-1])
    usable = (steps < 3.0 * log.period).ravel()
    slope, between = slope[usable].ravel(), between[usable].ravel()
    product = float(slope @ between)
    correlation = product / max(float(np.sqrt((slope @ slope) * (between @ between))), 1e-300)
    if correlation < 0.8:
        return []
    unit = float(slope @ slope) / product
    named = [name for name, size in TIME_UNITS.items() if 0.7 < unit / size < 1.4]
    return [name for name in named if name != "s"] if named else [f"{unit:.4g}"]


def share_of_speed(log: JointLog, robot: Articulated) -> float:
    """Return the fastest joint's speed as a share of its speed limit, from positions about ten samples apart.

    - `log`: a log with increasing times.
    - `robot`: the arm; 3 rad/s or 1 m/s replace missing speed limits.
    """
    stride = max(1, min(10, len(log.t) // 40))
    steps = log.t[stride:] - log.t[:-stride]
    usable = (steps > 0) & (steps < 3.0 * stride * log.period)
    if not usable.any():
        return 0.0
    speed = np.abs(log.q[stride:] - log.q[:-stride])[usable] / steps[usable, None]
    limits = np.asarray(robot.limits.velocity)
    limits = np.where(np.isfinite(limits), limits, [3.0 if unit == "rad" else 1.0 for unit in robot.joint_units])
    return float(np.max(np.quantile(speed, 0.98, axis=0) / limits))


def _sort_times(log: JointLog, backward: np.ndarray) -> tuple[JointLog, np.ndarray, str]:
    """Sort the samples by time if this makes the positions smoother; otherwise cut where the clock was set back.

    Returns the log, the rows at which to cut, and a warning.
    """
    order = np.argsort(log.t, kind="stable")
    size = np.ptp(log.q, axis=0) + 1e-12

    def path(q: np.ndarray) -> float:
        return float(np.sum(np.abs(np.diff(q, axis=0)) / size))

    first = int(backward[0])
    where = (
        f"sample {first + 1} of {log.source} is at {log.t[first]:.6g} s, the sample before at {log.t[first - 1]:.6g} s"
    )
    if path(log.q[order]) <= 1.02 * path(log.q):
        return log.rows(order), np.zeros(0, int), f"{where}: the samples are sorted by their times"
    # Shift each part to follow the previous one, so that the times increase.
    t = log.t.copy()
    for start in backward:
        t[start:] += t[start - 1] - t[start] + 2.0 * max(GAP_PERIODS * log.period, GAP_SECONDS)
    return replace(log, t=t), backward, f"{where}: the log is cut there, since its clock was set back"


def _merge_equal_times(log: JointLog, breaks: np.ndarray) -> tuple[JointLog, np.ndarray, int]:
    """Average samples with equal times.

    Returns the log, the new rows of its breaks, and the number of samples that were merged into others.
    """
    starts = np.concatenate([[True], np.diff(log.t) > 0])
    if starts.sum() < 2:
        raise DefinitionError(
            f"the times of {log.source} do not advance: all are {log.t[0]:g} s; `--columns t=NAME` reads another "
            "column, and messages need the time of their measurement in `header.stamp`"
        )
    if starts.all():
        return log, breaks, 0
    if starts.sum() < FEWEST:
        raise DefinitionError(
            f"{log.source} has {starts.sum()} different times in {len(starts)} samples: at least {FEWEST} are needed"
        )
    rows = np.nonzero(starts)[0]
    counts = np.diff(np.append(rows, len(starts)))[:, None]

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, rows, axis=0) / counts

    dq = None if log.dq is None else mean(log.dq)
    merged = replace(log, t=log.t[rows], q=mean(log.q), tau=mean(log.tau), dq=dq)
    return merged, (np.cumsum(starts) - 1)[breaks], int((~starts).sum())


def _drop_frozen(log: JointLog, breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return True for each row that was measured, and the indices of rows that follow a frozen stretch."""
    keep = np.ones(len(log.t), bool)
    bend = np.abs(np.diff(log.tau, 2, axis=0))
    usual = np.median(bend, axis=0)
    noisy = usual > 1e-6 * (np.ptp(log.tau, axis=0) + 1e-12)
    none = np.zeros(0, int)
    if not noisy.any():
        return keep, none
    straight = (bend[:, noisy] < 0.05 * usual[noisy]).all(axis=1)
    ends = np.diff(np.concatenate([[0], straight, [0]]))
    cuts = []
    moves = np.abs(np.diff(log.q, axis=0))
    usual_move = np.median(moves, axis=0)
    for start, stop in zip(np.nonzero(ends == 1)[0], np.nonzero(ends == -1)[0], strict=True):
        last = stop + 1
        if last - start < FROZEN_SAMPLES or log.t[last] - log.t[start] < FROZEN_SECONDS:
            continue
        after = min(last + 1, len(log.t) - 1)
        if (np.abs(log.q[after] - log.q[start]) > 5.0 * usual_move + 1e-9).any():
            # The first sample of the stretch was measured; the last one may repeat the sample before.
            keep[start + 1 : after] = False
            cuts.append(after)
    return keep, np.array(cuts, int)


def _gaps(count: int) -> str:
    return "a gap" if count == 1 else f"{count} gaps"


DEGREE = np.pi / 180.0

TWO_TURNS = 4.0 * np.pi
"""Position, rad, that a revolute joint without limits hardly exceeds."""

BEYOND = 0.5
"""Excess over the position limits, as a share of the range, above which a joint's unit is in doubt."""

APART = 0.3
"""Root mean square difference of the velocities dq from the slope of the positions q, as a share of the slope, above
which dq is not used."""

CORRELATED = 0.9
"""Correlation of dq with the slope of q above which a factor between them means another unit or sign."""

TRAVEL = {"rad": 0.02, "m": 0.005}
"""Range of positions below which a joint is treated as still, so that its dq shows nothing about units."""

DQ_DELAY = 0.1
"""Largest delay of dq after the slope of q, s."""


def require_radians(log: JointLog, robot: Articulated) -> None:
    """Raise a DefinitionError if positions look like degrees, millimetres or revolutions.

    - `log`: a log in the arm's joint order.
    - `robot`: the arm with its position limits.
    """
    lower, upper = np.asarray(robot.limits.lower), np.asarray(robot.limits.upper)
    least, most = log.q.min(axis=0), log.q.max(axis=0)
    turning = np.array([unit == "rad" for unit in robot.joint_units])
    limited = np.isfinite(lower) & np.isfinite(upper)
    slack = BEYOND * np.where(limited, upper - lower, 0.0)
    outside = np.where(limited, (most > upper + slack) | (least < lower - slack), turning & (_largest(log) > TWO_TURNS))
    for kind, size, unit in ((turning, DEGREE, "deg"), (~turning, 1e-3, "mm")):
        wrong = outside & kind
        if not wrong.any():
            continue
        joint = int(np.argmax(np.where(wrong, _largest(log), 0.0)))
        fits = (~limited | ((most * size <= upper + slack) & (least * size >= lower - slack)))[kind].all()
        right = "rad" if unit == "deg" else "m"
        limits = f"; its limits are {lower[joint]:.4g} to {upper[joint]:.4g} {right}" if limited[joint] else ""
        facts = (
            f"positions of {log.source} go from {least[joint]:.4g} to {most[joint]:.4g} for joint "
            f"`{log.joints[joint]}`{limits}"
        )
        if fits:
            name = "degrees" if unit == "deg" else "millimetres"
            raise DefinitionError(f"{facts}: are they {name}? `--position-unit {unit}` converts them")
        if limited[joint]:
            raise DefinitionError(
                f"{facts}: check `--position-unit`, `--position-order`, and `--position-offset` for another zero"
            )


def _largest(log: JointLog) -> np.ndarray:
    return np.abs(log.q).max(axis=0)


def find_usable_velocities(
    log: JointLog, robot: Articulated, slope: np.ndarray, velocity: np.ndarray, noise: np.ndarray, rate: float
) -> tuple[np.ndarray, list[str]]:
    """Return True for each joint whose measured velocity agrees with its positions' slope [n], and warnings.

    - `log`, `robot`: the log and its arm.
    - `slope`, `velocity`: slope of the positions and measured velocity, after the regression's low-pass filter [k n].
    - `noise`: standard deviation of the slope's noise after this filter [n].
    - `rate`: sampling rate [Hz].

    Raises DefinitionError if a joint's velocity is a clear multiple of the slope, as with a wrong unit.
    """
    size = _rms(slope)
    usable = _rms(velocity - slope) <= APART * size
    if usable.all():
        return usable, []
    travels = np.ptp(log.q, axis=0) > np.array([TRAVEL[unit] for unit in robot.joint_units])
    travels &= size > 5.0 * noise
    if not (_rms(velocity) > 1e-3 * size)[travels].any() and travels.any():
        return np.zeros_like(usable), [f"`dq` of {log.source} is 0 throughout while the arm moves: it is left out"]
    factors: dict[int, float] = {}
    for joint in np.nonzero(~usable & travels)[0]:
        factor, correlation = _best_factor(slope[:, joint], velocity[:, joint], rate)
        if correlation > CORRELATED and not 0.75 < factor < 1.33:
            factors[int(joint)] = factor
    if factors:
        raise DefinitionError(_velocity_unit_error(log, factors, int(travels.sum())))
    _require_own_velocity(log, slope, velocity, usable, travels)
    names = ", ".join(f"`{log.joints[joint]}`" for joint in np.nonzero(~usable)[0])
    return usable, [f"`dq` of {log.source} does not follow the slope of `q` for {names}: it is left out there"]


def _best_factor(slope: np.ndarray, velocity: np.ndarray, rate: float) -> tuple[float, float]:
    """Return the ratio of velocity to slope at the delay with the highest correlation, and this correlation."""
    most = max(1, min(int(DQ_DELAY * rate), len(slope) // 4))
    best = (0.0, 0.0)
    for shift in np.unique(np.linspace(-most, most, 41).astype(int)):
        a = slope[max(0, -shift) : len(slope) - max(0, shift)]
        b = velocity[max(0, shift) : len(velocity) - max(0, -shift)]
        product = float(a @ b)
        correlation = abs(product) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)
        if correlation > best[1]:
            best = (product / max(float(a @ a), 1e-300), correlation)
    return best


def _velocity_unit_error(log: JointLog, factors: dict[int, float], travelling: int) -> str:
    joint = max(factors, key=lambda j: abs(np.log(abs(factors[j]))))
    factor = factors[joint]
    values = np.array(list(factors.values()))
    facts = f"`dq` of {log.source} is {factor:.3g} times the slope of `q` for joint `{log.joints[joint]}`"
    leave = "`--drop dq` leaves `dq` out"
    if len(factors) < travelling or np.ptp(values) > 0.2 * abs(factor):
        if abs(factor + 1.0) < 0.2:
            return f"{facts}; do `q` and `dq` have opposite signs? `--position-sign` would change both; {leave}"
        return f"{facts}; {leave}"
    for name, unit in TIME_UNITS.items():
        if name != "s" and abs(factor * unit - 1.0) < 0.2:
            return f"{facts}: are the times in {name}? `--time-unit {name}` converts them; {leave}"
    if abs(factor * DEGREE - 1.0) < 0.2:
        return f"{facts}: is `dq` in degrees per second? {leave}"
    if abs(factor / DEGREE - 1.0) < 0.2:
        return f"{facts}: is `q` in degrees? `--position-unit deg --drop dq` converts it"
    if factor > 0.0:
        size = f"{1.0 / factor:.4g}"
        return f"{facts} in all joints: are the times in units of {size} s? `--time-unit {size}` converts them; {leave}"
    return f"{facts} in all joints; {leave}"


def _require_own_velocity(
    log: JointLog, slope: np.ndarray, velocity: np.ndarray, usable: np.ndarray, travels: np.ndarray
) -> None:
    """Raise a DefinitionError if a joint's velocity is the slope of another joint's position."""
    for joint in np.nonzero(~usable & travels)[0]:
        for other in np.nonzero(~usable & travels)[0]:
            if joint != other and _rms(velocity[:, joint] - slope[:, other]) < 0.2 * _rms(slope[:, other]):
                raise DefinitionError(
                    f"`dq` of {log.source} for joint `{log.joints[joint]}` is the slope of `q` for joint "
                    f"`{log.joints[other]}`: positions and velocities are in different joint orders; "
                    "`--drop dq` leaves `dq` out"
                )


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


WRAP = 0.5
"""A step between two samples within this distance of 2π is a wrapped angle [rad]."""

SPIKE = 30.0
"""Distance of an outlier from the neighbours' median, as a multiple of the usual distance."""

RANGE = 1.5
"""Distance of an outlier from the neighbours' median, as a multiple of the column's 1 % to 99 % range."""

MOST = 0.02
"""Largest share of outliers to remove; more are not single faults."""


def remove_outliers(log: JointLog, robot: Articulated) -> tuple[JointLog, list[str]]:
    """Return the log with unwrapped angles and without single faulty samples, and warnings about both."""
    warnings: list[str] = []
    q = log.q.copy()
    for joint, unit in enumerate(robot.joint_units):
        steps = np.diff(q[:, joint])
        if unit == "rad" and len(steps) and (np.abs(np.abs(steps) - 2.0 * np.pi) < WRAP).any():
            turns = np.where(np.abs(np.abs(steps) - 2.0 * np.pi) < WRAP, np.sign(steps), 0.0)
            around = 2.0 * np.pi * np.cumsum(np.concatenate([[0.0], turns]))
            # A spike of 2π jumps back at once; a true wrap does not.
            if np.median(np.abs(np.diff(q[:, joint] - around))) <= np.median(np.abs(steps)) + 1e-12:
                q[:, joint] -= around
                warnings.append(
                    f"positions of {log.source} jump by a full turn for joint `{log.joints[joint]}`: they are unwrapped"
                )
    wrong = np.zeros(len(log.t), bool)
    for values in (q, log.tau, *([] if log.dq is None else [log.dq])):
        for column in values.T:
            distance = np.abs(column - ndimage.median_filter(column, 7, mode="nearest"))
            low, high = np.quantile(column, [0.01, 0.99])
            usual = np.quantile(distance, 0.9)
            wrong |= (distance > SPIKE * usual) & (distance > RANGE * (high - low)) & (high > low)
    count = int(wrong.sum())
    if not 0 < count <= MOST * len(wrong) or len(wrong) - count < FEWEST:
        return replace(log, q=q), warnings
    first = int(np.argmax(wrong))
    warnings.append(
        f"{count} samples of {log.source} are far from their neighbours, first sample {first + 1}: they are left out"
    )
    return replace(log, q=q).rows(~wrong), warnings
