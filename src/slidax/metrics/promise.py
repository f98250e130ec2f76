"""Metrics of the monitor that says whether a law's promise still stands."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .metric import array_of, arrays, metric, of_the_run


@metric("margin of the guarantee", "", per_joint=False, least_is_best=False)
def guarantee_margin(run: Run) -> np.ndarray | float | None:
    """The least margin that the monitor said; negative where the promise did not stand; None without a monitor.

    - `run`: a finished run, or a batch.
    """
    if run.tally.promise is None:
        return None
    margin = array_of(run.tally.promise.margin)
    return of_the_run(arrays(run).isfinite(margin), margin)


@metric("first warning of the monitor", "s", per_joint=False, least_is_best=False, counts=True)
def warned_at(run: Run) -> np.ndarray | float | None:
    """When the monitor first said that the promise does not stand [s]; None if it never did, or without a monitor.

    - `run`: a finished run, or a batch.
    """
    if run.tally.promise is None:
        return None
    warned = array_of(run.tally.promise.warned)
    return of_the_run(warned >= 0, warned * array_of(run.period))
