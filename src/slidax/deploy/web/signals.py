"""What a page draws of every sample."""

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
    "assumption_violated": ("whether the law's monitor says that its promise does not stand", ""),
}
"""By name what each is, and of what it has the unit."""


def signals_of(loop: Loop, before: Carry, log: Log) -> dict[str, Any]:
    """The signals of one sample, each one number or [n].

    Bounds are those of the scheme's envelope, or of the tolerance band that judges a scheme without one.

    - `loop`: the closed loop.
    - `before`: the carry before the sample.
    - `log`: the sample.
    """
    e = log.e
    found = {"t": log.t, "q": log.state.q, "e": e, "tau": log.tau}
    bounds = bounds_of(loop, before, log)
    if bounds is not None:
        nearer = jnp.minimum(e - bounds.lower, bounds.upper - e) / (bounds.upper - bounds.lower)
        found |= {"lower": bounds.lower, "upper": bounds.upper, "margin": nearer}
        found["rho"] = jnp.maximum(bounds.upper, -bounds.lower)
    if before.tally.promise is not None:
        found["assumption_violated"] = (log.signals["margin"] < 0.0).astype(float)
    return found


def bounds_of(loop: Loop, before: Carry, log: Log) -> Envelope | None:
    """Those of the scheme's envelope, or of the tolerance band.

    - `loop`, `before`, `log`: as in `signals_of`.
    """
    if log.envelope is not None or loop.tolerance is None:
        return log.envelope
    assert before.tally.tolerance is not None
    t: Any = log.t
    return loop.tolerance.envelope(t, before.tally.tolerance.sides)
