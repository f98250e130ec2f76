"""Metrics of the envelope: violations and margin."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .metric import array_of, metric, where


@metric("samples outside the envelope", "", per_joint=False, counts=True)
def envelope_violations(run: Run) -> np.ndarray | int | None:
    """Number of samples with a joint at or outside its bounds (12); None for a scheme without an envelope."""
    if not run.has_envelope:
        return None
    violations = array_of(run.tally.violations)
    return violations if violations.ndim else int(violations)


@metric("envelope margin", "of its width", least_is_best=False)
def envelope_margin(run: Run) -> np.ndarray | None:
    """Least distance to the nearer bound over the run, over the envelope's width.

    None for a scheme without an envelope, and for a run whose very first sample was not good.
    """
    return where(array_of(run.tally.samples) > 0, array_of(run.tally.margin)) if run.has_envelope else None
