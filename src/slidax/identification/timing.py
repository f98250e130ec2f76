"""Times of a log: their unit, their order, and the gaps between them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Articulated

from .conventions import TIME_UNITS
from .log import FEWEST, Log

SLOWEST, FASTEST = 8.0, 50_000.0
"""Sampling rates [Hz] of logs: below, no rotor shows; above, no robot's driver writes."""

BRIEFEST = 0.5
"""Seconds that a log lasts at least."""

GAP_PERIODS, GAP_SECONDS = 5.0, 0.02
"""A time without samples is a gap if it is longer than both: a shorter one is filled by a monotone cubic curve."""

FROZEN_SAMPLES, FROZEN_SECONDS = 8, 0.05
"""Torques that follow straight lines for longer than both, while the arm moves, were not measured."""

FAST, USUAL = 4.0, 1.0
"""Speeds, as multiples of a joint's limit, that no log shows and that a log may well show."""

STILL = 2e-3
"""A share of the speed limit, below which an arm does not move."""


@dataclass(frozen=True, eq=False)
class Timed:
    """A log whose times increase, cut where nothing was measured.

    - `log`: its samples in order.
    - `pieces`: rows without a gap between them.
    - `warnings`: sentences on what was left out.
    """

    log: Log
    pieces: tuple[slice, ...]
    warnings: tuple[str, ...]


def timed(log: Log, robot: Articulated) -> Timed:
    """Judge the times of a log, and cut it at its gaps.

    - `robot`: its speed limits show wrong units.

    Raises DefinitionError if the times do not advance, or are in another unit than s.
    """
    warnings: list[str] = []
    breaks = np.zeros(0, int)
    backward = np.nonzero(np.diff(log.t) < 0)[0] + 1
    if len(backward):
        log, breaks, sentence = _in_order(log, backward)
        warnings.append(sentence)
    log, breaks, merged = _merged(log, breaks)
    if merged:
        warnings.append(f"{merged} samples of {log.source} repeat the time of the sample before: they are averaged")
    require_seconds(log, robot)
    keep, cuts = _frozen(log, breaks)
    if not keep.all():
        first = int(np.argmin(keep))
        warnings.append(
            f"torques of {log.source} repeat or follow straight lines for {log.period * (~keep).sum():.3g} s, first at "
            f"{log.t[first]:.4g} s: these samples are left out, since nothing was measured there"
        )
        place = np.cumsum(keep) - keep
        breaks = np.unique(np.concatenate([place[breaks], place[cuts]]))
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
    return Timed(log, tuple(pieces), tuple(warnings))


def require_seconds(log: Log, robot: Articulated) -> None:
    """Raise a DefinitionError if the times of a log are in another unit than s.

    - `log`: with times that increase.
    - `robot`: its speed limits show wrong units.
    """
    rate, duration, speed = 1.0 / log.period, float(np.sum(np.diff(log.t).clip(0))), share_of_speed(log, robot)

    def is_possible(unit: float) -> bool:
        return (
            SLOWEST <= rate / unit <= FASTEST
            and duration * unit >= BRIEFEST
            and STILL * USUAL <= speed / unit <= FAST * USUAL
        )

    others = _by_velocities(log) or [name for name, unit in TIME_UNITS.items() if name != "s" and is_possible(unit)]
    facts = f"the times of {log.source} are {duration:.4g} s long with {rate:.3g} samples per second"
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


def _by_velocities(log: Log) -> list[str]:
    """The unit of time in which the measured velocities are the slope of the positions; none if none is clear."""
    if log.dq is None or not log.dq.any():
        return []
    steps = np.diff(log.t)[:, None]
    slope, between = np.diff(log.q, axis=0) / steps, 0.5 * (log.dq[1:] + log.dq[:-1])
    usable = (steps < 3.0 * log.period).ravel()
    slope, between = slope[usable].ravel(), between[usable].ravel()
    product = float(slope @ between)
    alike = product / max(float(np.sqrt((slope @ slope) * (between @ between))), 1e-300)
    if alike < 0.8:
        return []
    unit = float(slope @ slope) / product
    named = [name for name, size in TIME_UNITS.items() if 0.7 < unit / size < 1.4]
    return [name for name in named if name != "s"] if named else [f"{unit:.4g}"]


def share_of_speed(log: Log, robot: Articulated) -> float:
    """The speed of the fastest joint as a share of its speed limit, from positions some ten samples apart.

    - `log`: with times that increase.
    - `robot`: its limits; 3 rad/s or 1 m/s where it has none.
    """
    apart = max(1, min(10, len(log.t) // 40))
    steps = log.t[apart:] - log.t[:-apart]
    usable = (steps > 0) & (steps < 3.0 * apart * log.period)
    if not usable.any():
        return 0.0
    speed = np.abs(log.q[apart:] - log.q[:-apart])[usable] / steps[usable, None]
    limits = np.asarray(robot.limits.velocity)
    limits = np.where(np.isfinite(limits), limits, [3.0 if unit == "rad" else 1.0 for unit in robot.joint_units])
    return float(np.max(np.quantile(speed, 0.98, axis=0) / limits))


def _in_order(log: Log, backward: np.ndarray) -> tuple[Log, np.ndarray, str]:
    """Samples sorted by their times if the positions are smoother so, else cut where the clock was set back."""
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
    # Each part goes on after the one before, so that the times increase.
    t = log.t.copy()
    for start in backward:
        t[start:] += t[start - 1] - t[start] + 2.0 * max(GAP_PERIODS * log.period, GAP_SECONDS)
    return replace(log, t=t), backward, f"{where}: the log is cut there, since its clock was set back"


def _merged(log: Log, breaks: np.ndarray) -> tuple[Log, np.ndarray, int]:
    """Samples of equal times are averaged."""
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


def _frozen(log: Log, breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows that were measured, and the rows before which others were left out."""
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
            # The last of them may be a value that was held.
            keep[start + 1 : after] = False
            cuts.append(after)
    return keep, np.array(cuts, int)


def _gaps(count: int) -> str:
    return "a gap" if count == 1 else f"{count} gaps"
