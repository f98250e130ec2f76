"""Signals that a page plots."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from slidax._types import Envelope
from slidax.simulation.loop import Carry, Loop
from slidax.simulation.run import Log

TITLES = {
    "q": ("position", "position"),
    "e": ("error", "position"),
    "rho": ("radius of the envelope", "position"),
    "lower": ("lower bound of the error", "position"),
    "upper": ("upper bound of the error", "position"),
    "tau": ("torque", "torque"),
    "margin": ("distance to the nearer bound, of the width", ""),
    "assumption_violated": ("1 where the law's monitor reports its guarantee void", ""),
}
"""Title of each signal, and the quantity whose unit it has."""


def signals_of(loop: Loop, before: Carry, log: Log) -> dict[str, Any]:
    """Signals of one sample, each a scalar or [n].

    Bounds are those of the scheme's envelope, or of the tolerance band that judges a scheme without one.
    """
    e = log.e
    signals = {"t": log.t, "q": log.state.q, "e": e, "tau": log.tau}
    bounds = bounds_of(loop, before, log)
    if bounds is not None:
        nearer = jnp.minimum(e - bounds.lower, bounds.upper - e) / (bounds.upper - bounds.lower)
        signals |= {"lower": bounds.lower, "upper": bounds.upper, "margin": nearer}
        signals["rho"] = jnp.maximum(bounds.upper, -bounds.lower)
    if before.tally.promise is not None:
        signals["assumption_violated"] = (log.signals["margin"] < 0.0).astype(float)
    return signals


def bounds_of(loop: Loop, before: Carry, log: Log) -> Envelope | None:
    """Bounds of the scheme's envelope, or of the tolerance band."""
    if log.envelope is not None or loop.tolerance is None:
        return log.envelope
    assert before.tally.tolerance is not None
    t: Any = log.t
    return loop.tolerance.envelope(t, before.tally.tolerance.sides)
