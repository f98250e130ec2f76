"""Metrics of the tolerance band that judges a run, whatever its scheme promises."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .metric import array_of, arrays, metric, where


@metric("samples outside the tolerance band", "", per_joint=False, counts=True)
def tolerance_violations(run: Run) -> np.ndarray | int | None:
    """Number of samples with a joint at or outside the tolerance band; None for a run without one."""
    if run.tally.tolerance is None:
        return None
    outside = array_of(run.tally.tolerance.outside)
    return outside if outside.ndim else int(outside)


@metric("tolerance margin", "of its width", least_is_best=False)
def tolerance_margin(run: Run) -> np.ndarray | None:
    """Least distance to the nearer bound over the run, relative to the band's width; below 0 outside.

    None for a run without a tolerance band, and for one whose very first state was not finite.
    """
    if run.tally.tolerance is None:
        return None
    margin = array_of(run.tally.tolerance.margin)
    return where(arrays(run).isfinite(margin).all(axis=-1), margin)
