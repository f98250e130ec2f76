"""Metrics of the torque."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run

from .error import reached_last_quarter
from .metric import array_of, arrays, integral, metric, root, where


@metric("peak torque", "{torque}", brief=True)
def peak_torque(run: Run) -> np.ndarray:
    """`max |τ|` over the run."""
    return array_of(run.tally.peak_torque)


@metric("initial torque", "{torque}")
def initial_torque(run: Run) -> np.ndarray:
    """`|τ(0)|`."""
    return abs(array_of(run.tally.first_torque))


@metric("torque step, max", "{torque}", brief=True)
def max_torque_step(run: Run) -> np.ndarray:
    """`max |τ(k+1) - τ(k)|` over the run."""
    return array_of(run.tally.max_step)


@metric("torque step, steady", "{torque}", brief=True)
def steady_torque_step(run: Run) -> np.ndarray | None:
    """`max |τ(k+1) - τ(k)|` over the last quarter of the run."""
    return where(reached_last_quarter(run), array_of(run.tally.steady_step))


@metric("torque step, steady, rms", "{torque}")
def steady_torque_step_rms(run: Run) -> np.ndarray | None:
    """Root mean square of `τ(k+1) - τ(k)` over the last quarter of the run."""
    xp = arrays(run)
    steps = array_of(run.tally.samples) - 1 - array_of(run.windows.steady)
    square = array_of(run.tally.steady_square) / xp.maximum(steps, 1).astype(float)[..., None]
    return where(reached_last_quarter(run), root(xp, square))


@metric("torque energy", "({torque})² s", brief=True, bars=True)
def torque_energy(run: Run) -> np.ndarray:
    """`∫ τ² dt` over the run.

    By the trapezoidal rule on all samples. A motor's winding turns it into heat.
    """
    first, last = array_of(run.tally.first_torque), array_of(run.tally.last_torque)
    return integral(run, run.tally.torque_square, first**2, last**2)


@metric("torque travel", "{torque}", brief=True, bars=True)
def torque_travel(run: Run) -> np.ndarray:
    """`Σ |τ(k+1) - τ(k)|` over the run: how far the torque goes up and down.

    For a torque without jumps it does not depend on the period; one that chatters travels the more, the shorter it is.
    """
    return array_of(run.tally.torque_travel)
