"""Metrics of the tube that judges a run, whatever its scheme promises."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .metric import array_of, arrays, metric, where


@metric("samples outside the tube", "", per_joint=False, counts=True)
def tube_violations(run: Run) -> np.ndarray | int | None:
    """How many samples had a joint at or outside the tube; None for a run without one.

    - `run`: a finished run, or a batch.
    """
    if run.tally.tube is None:
        return None
    outside = array_of(run.tally.tube.outside)
    return outside if outside.ndim else int(outside)


@metric("tube margin", "of its width", least_is_best=False)
def tube_margin(run: Run) -> np.ndarray | None:
    """Least distance to the nearer side of the tube over the run, over the tube's width; below 0 outside.

    None for a run without a tube, and for one whose very first state was not finite.

    - `run`: a finished run, or a batch.
    """
    if run.tally.tube is None:
        return None
    margin = array_of(run.tally.tube.margin)
    return where(arrays(run).isfinite(margin).all(axis=-1), margin)
