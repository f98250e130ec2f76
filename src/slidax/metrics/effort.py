"""What the joints are asked for."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .error import reached_last_quarter


def peak_torque(run: Run) -> np.ndarray:
    """`max |τ|`, [n], N m or N.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.peak_torque)


def initial_torque(run: Run) -> np.ndarray:
    """`|τ(0)|`, [n], N m or N.

    - `run`: a finished run.
    """
    return np.abs(np.asarray(run.tally.first_torque))


def max_torque_step(run: Run) -> np.ndarray:
    """`max |τ(k+1) - τ(k)|`, [n], N m or N.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.max_step)


def steady_torque_step(run: Run) -> np.ndarray | None:
    """`max |τ(k+1) - τ(k)|` over the last quarter of the run, [n], N m or N; None if the run ended before it.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.steady_step) if reached_last_quarter(run) else None


def steady_torque_step_rms(run: Run) -> np.ndarray | None:
    """Root mean square of `τ(k+1) - τ(k)` over the last quarter of the run, [n], N m or N; None if it ended before.

    - `run`: a finished run.
    """
    if not reached_last_quarter(run):
        return None
    steps = int(run.tally.samples) - 1 - int(run.windows.steady)
    return np.sqrt(np.asarray(run.tally.steady_square) / max(steps, 1))


def eci(run: Run) -> np.ndarray:
    """`ECI = Σ |τ(k)|²`, eq. (81); a sum without the period, as printed, [n], (N m)² or N².

    - `run`: a finished run.
    """
    return np.asarray(run.tally.eci)


def aice(run: Run) -> np.ndarray:
    """`AICE = Σ |τ(k+1) - τ(k)|`, eq. (82), [n], N m or N: the length of the way that the torque goes up and down.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.aice)
