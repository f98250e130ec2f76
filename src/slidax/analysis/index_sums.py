"""Performance indices of the paper, eqs. (80) to (82): sums over a run's position errors and torques."""

from __future__ import annotations

import numpy as np

from slidax.simulation.run import Run

from .metric import Metric, array_of, metric

DOI = "10.1007/s11071-022-07650-w"


@metric("IAE (80)", "{position}", key="paper.iae", source=DOI)
def iae(run: Run) -> np.ndarray:
    """`IAE = Σ |e(k)|` over the samples with t > 2 s, eq. (80) of the paper.

    One value per joint; e is the position error.

    - `run`: a finished run, or a batch.
    """
    return array_of(run.tally.late_error)


@metric("ECI (81)", "({torque})²", key="paper.eci", source=DOI)
def eci(run: Run) -> np.ndarray:
    """`ECI = Σ |τ(k)|²` over all samples, eq. (81) of the paper.

    One value per joint.

    - `run`: a finished run, or a batch.
    """
    return array_of(run.tally.torque_square)


@metric("AICE (82)", "{torque}", key="paper.aice", source=DOI)
def aice(run: Run) -> np.ndarray:
    """`AICE = Σ |τ(k+1) - τ(k)|` over all samples, eq. (82) of the paper.

    One value per joint.

    - `run`: a finished run, or a batch.
    """
    return array_of(run.tally.torque_travel)


INDEX_SUMS: tuple[Metric[np.ndarray], ...] = (iae, eci, aice)
"""The paper's performance indices as metrics."""
