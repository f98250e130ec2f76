"""Numbers of runs that no general metric gives."""

from __future__ import annotations

import numpy as np

from slidax import metrics
from slidax.scenarios import Scenario
from slidax.simulation import Run

from .. import indices
from .bounds import parts_of
from .verdicts import CLOSE


def steady_error(run: Run) -> list[float] | None:
    """`max |e|` over the logged second half of the run, [n]: in Example 4.2 the last full period of the motion.

    - `run`: a finished run with a log.

    None if the run ended before its end.
    """
    if not run.outcome.ok or run.log is None:
        return None
    late = np.asarray(run.log.t) > 0.5 * float(run.t1)
    return [float(size) for size in np.abs(np.asarray(run.log.e)[late]).max(axis=0)]


def table_3(run: Run, quantity: str, band: float) -> list[float | None]:
    """A quantity of Table 3, one per joint.

    - `run`: a finished run with a log.
    - `quantity`: `settling_time`, `steady_error` or `peak_torque`.
    - `band`: settling band, rad or m.
    """
    if quantity == "steady_error":
        errors = steady_error(run)
        return [None] * len(run.joint_units) if errors is None else [*errors]
    values = metrics.settling_time(run, band) if quantity == "settling_time" else metrics.peak_torque(run)
    # Still outside the band at the end: the run has no such time.
    late = quantity == "settling_time"
    return [None if late and value >= float(run.t1) - 1e-9 else float(value) for value in values]


def worst_after_deadline(scenario: Scenario, run: Run) -> list[float] | None:
    """`max |e| / ρ∞` from the deadline T of each joint on, [n]; None if the run ended before.

    - `scenario`: what was simulated.
    - `run`: its run, with a log.
    """
    performance = parts_of(scenario).performance
    if run.log is None or not run.outcome.ok:
        return None
    t, sizes = np.asarray(run.log.t), np.abs(np.asarray(run.log.e))
    deadline, final = (np.broadcast_to(np.asarray(x), run.joints) for x in (performance.deadline, performance.final))
    if t[-1] < deadline.max():
        return None
    return [float(sizes[t >= deadline[i], i].max() / final[i]) for i in range(run.joints)]


def step_ratio(run: Run, halved: Run) -> tuple[list[float], list[float]]:
    """Effect of halving the step: the largest torque step over the one before, and AICE likewise, [n] each.

    For a continuous torque the first is about 1/2 and the second about 1; for one that chatters, both are not.

    - `run`: at the step.
    - `halved`: at half the step.
    """
    pairs = [(metrics.max_torque_step(r), indices.aice(r)) for r in (run, halved)]
    (step, way), (half_step, half_way) = pairs
    return (half_step / step).tolist(), (half_way / way).tolist()


def chatter(run: Run, halved: Run) -> list[float | None]:
    """Factor by which AICE grows when the step is halved, [n], for joints whose torque chatters, and None for others.

    The way of a continuous torque does not depend on the step; that of one which jumps at every sample does. It counts
    as chattering if it changes by more than the fraction within which numbers are called close.

    - `run`: at the step.
    - `halved`: at half the step.
    """
    ways = indices.aice(halved) / indices.aice(run)
    return [float(way) if abs(way - 1.0) > CLOSE else None for way in ways]
