"""Metrics of the monitor that says whether a law's promise still stands."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .metric import metric


@metric("margin of the promise", "", per_joint=False, least_is_best=False)
def promise_margin(run: Run) -> np.ndarray | float | None:
    """The least margin that the monitor said; negative where the promise did not stand; None without a monitor.

    - `run`: a finished run, or a batch.
    """
    if run.tally.promise is None:
        return None
    margin = np.asarray(run.tally.promise.margin)
    return _known(np.isfinite(margin), margin)


@metric("first warning of the monitor", "s", per_joint=False, least_is_best=False)
def warned_at(run: Run) -> np.ndarray | float | None:
    """When the monitor first said that the promise does not stand [s]; None if it never did, or without a monitor.

    - `run`: a finished run, or a batch.
    """
    if run.tally.promise is None:
        return None
    warned = np.asarray(run.tally.promise.warned)
    return _known(warned >= 0, warned * np.asarray(run.period))


def _known(known: np.ndarray, values: np.ndarray) -> np.ndarray | float | None:
    """One number of a run, or None if it is not known; those of a batch, masked where they are not."""
    if values.ndim == 0:
        return float(values) if known else None
    masked: np.ndarray = np.ma.masked_array(values, ~known)
    return masked
