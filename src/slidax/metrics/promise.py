"""Metrics of the monitor, which checks the assumptions of a law's guarantee."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .metric import array_of, arrays, metric, of_the_run


@metric("margin of the guarantee", "", per_joint=False, least_is_best=False)
def guarantee_margin(run: Run) -> np.ndarray | float | None:
    """Least margin of the guarantee over the run, by the monitor; negative where it fails; None without a monitor."""
    if run.tally.promise is None:
        return None
    margin = array_of(run.tally.promise.margin)
    return of_the_run(arrays(run).isfinite(margin), margin)


@metric("first warning of the monitor", "s", per_joint=False, least_is_best=False, counts=True)
def warned_at(run: Run) -> np.ndarray | float | None:
    """Time of the monitor's first warning [s]; None if there was none, or without a monitor."""
    if run.tally.promise is None:
        return None
    warned = array_of(run.tally.promise.warned)
    return of_the_run(warned >= 0, warned * array_of(run.period))
