"""How small the error is, and how soon."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.simulation import Run


def settling_time(run: Run, band: float) -> np.ndarray:
    """The last sample time at which |e| is above the band, [n], s; 0 if it never is, `t1` if it still is at the end.

    - `run`: a finished run.
    - `band`: one of the bands that were tallied, rad or m.

    Raises DefinitionError if the band was not tallied.
    """
    bands = np.asarray(run.windows.bands)
    match = np.flatnonzero(np.isclose(bands, band, rtol=1e-9, atol=0.0))
    if not len(match):
        known = ", ".join(f"{b:g}" for b in bands)
        remedy = f"simulate with `bands=({band:g},)`"
        raise DefinitionError(f"the band {band:g} was not tallied; there are {known}; {remedy}")
    last = np.maximum(np.asarray(run.tally.last_above)[match[0]], 0)
    # Rounded to a picosecond: 7614 periods of 1e-4 s are .7614 s, not .7614000000000001 s.
    times: np.ndarray = np.round(last * float(run.period), 12)
    return times


def steady_error(run: Run) -> np.ndarray | None:
    """`max |e|` over the last quarter of the run, [n], rad or m; None if the run ended before it.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.steady_error) if reached_last_quarter(run) else None


def reached_last_quarter(run: Run) -> bool:
    """Whether the run has samples in its last quarter, from which steady values are taken.

    - `run`: a finished run.
    """
    return int(run.tally.samples) > int(run.windows.steady)


def iae(run: Run) -> np.ndarray:
    """`IAE = Σ |e(k)|` over the samples with t > 2 s, eq. (80); a sum without the period, as printed, [n], rad or m.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.iae)
