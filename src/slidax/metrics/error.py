"""Metrics of the error and of its settling."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, is_traced
from slidax.simulation import Run

from .metric import Metric, array_of, arrays, counting, integral, metric, root, where

BRIEF_BANDS = (1e-3, 1e-5)
"""The settling bands of the short comparison on a terminal, rad or m."""


def settling_time(run: Run, band: float) -> np.ndarray:
    """The last sample time at which |e| is above the band, [n], s; 0 if it never is, `t1` if it still is at the end.

    - `band`: one of the bands that were tallied, rad or m.

    Raises DefinitionError if the band was not tallied, or the run is traced.
    """
    if is_traced(run.tally):
        raise counting("settling_time")
    bands = _bands(run)
    match = np.flatnonzero(np.isclose(bands, band, rtol=1e-9, atol=0.0))
    if not len(match):
        known = ", ".join(f"{b:g}" for b in bands)
        remedy = f"simulate with `bands=({band:g},)`"
        raise DefinitionError(f"the band {band:g} was not tallied; there are {known}; {remedy}")
    last = np.maximum(array_of(run.tally.last_above)[..., match[0], :], 0)
    # Rounded to a picosecond: 7614 periods of 1e-4 s are .7614 s, not .7614000000000001 s.
    return np.round(last * array_of(run.period)[..., None], 12)


def settling_times(run: Run) -> tuple[Metric[np.ndarray], ...]:
    """The settling time at each band that was tallied, as metrics."""

    def settled(run: Run, band: float) -> np.ndarray:
        """Last sample time with |e| above the band."""
        return settling_time(run, band)

    metrics = []
    for band in _bands(run):
        function = partial(settled, band=float(band))
        function.__doc__ = settled.__doc__
        brief = bool(np.isclose(band, BRIEF_BANDS, atol=0.0).any())
        name = _named(band)
        key, title = f"settling_time.{name}", f"settled to |e| <= {name}"
        metrics.append(Metric(key, title, "s", function, brief=brief, needs_settling=True, counts=True))
    return tuple(metrics)


@metric("steady error", "{position}", brief=True)
def steady_error(run: Run) -> np.ndarray | None:
    """`max |e|` over the last quarter of the run."""
    return where(reached_last_quarter(run), array_of(run.tally.steady_error))


@metric("error, rms", "{position}")
def rms_error(run: Run) -> np.ndarray | None:
    """Root mean square of e over the run."""
    tally = run.tally
    first, last = array_of(tally.first_error), array_of(tally.last_error)
    samples = array_of(tally.samples)
    duration = arrays(run).maximum(samples - 1, 1).astype(float) * array_of(run.period)
    mean = integral(run, tally.error_square, first**2, last**2) / duration[..., None]
    # Of a run without motion the difference of equal sums may fall a rounding below zero.
    return where(samples > 1, root(arrays(run), mean))


@metric("integral of |e|", "{position} s", brief=True, bars=True)
def iae(run: Run) -> np.ndarray:
    """`∫ |e| dt` over the run.

    By the trapezoidal rule on all samples, so that it does not depend on the period.
    """
    tally = run.tally
    total = array_of(tally.early_error) + array_of(tally.late_error)
    return integral(run, total, tally.first_error, tally.last_error)


def reached_last_quarter(run: Run) -> Any:
    """True if the run has samples in its last quarter, from which steady values are taken, [] or [runs]."""
    return array_of(run.tally.samples) > array_of(run.windows.steady)


def _bands(run: Run) -> np.ndarray:
    return np.atleast_2d(run.windows.bands)[0]


def _named(band: float) -> str:
    """`1e-3` rather than `0.001`."""
    mantissa, exponent = f"{band:e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
