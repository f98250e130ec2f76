"""The three index sums of the paper on approximate continuous fixed-time terminal sliding mode control, as printed.

Source: Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w, eqs. (80)-(82). They are sums without the period,
so that runs with different periods cannot be compared by them; `slidax.metrics` has integrals for that.
"""

from __future__ import annotations

import numpy as np

from slidax.metrics import Metric, array_of, metric
from slidax.simulation import Run

DOI = "10.1007/s11071-022-07650-w"


@metric("IAE (80)", "{position}", key="paper.iae", source=DOI)
def iae(run: Run) -> np.ndarray:
    """`IAE = Σ |e(k)|` over the samples with t > 2 s, eq. (80).

    - `run`: a finished run, or a batch.
    """
    return array_of(run.tally.late_error)


@metric("ECI (81)", "({torque})²", key="paper.eci", source=DOI)
def eci(run: Run) -> np.ndarray:
    """`ECI = Σ |τ(k)|²` over all samples, eq. (81).

    - `run`: a finished run, or a batch.
    """
    return array_of(run.tally.torque_square)


@metric("AICE (82)", "{torque}", key="paper.aice", source=DOI)
def aice(run: Run) -> np.ndarray:
    """`AICE = Σ |τ(k+1) - τ(k)|` over all samples, eq. (82).

    - `run`: a finished run, or a batch.
    """
    return array_of(run.tally.torque_travel)


INDICES: tuple[Metric[np.ndarray], ...] = (iae, eci, aice)
"""All three."""
