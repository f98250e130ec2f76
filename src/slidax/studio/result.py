"""A run in the format of the page: outcome, signals, metrics."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax.metrics import summary
from slidax.papers.indices import INDICES

if TYPE_CHECKING:
    from slidax.scenarios import Scenario
    from slidax.simulation import Run


def result_of(run: Run, scenario: Scenario, milliseconds: float) -> tuple[dict[str, Any], bytes]:
    """The head and the bytes of a result: for each signal as many rows as samples, 64-bit numbers.

    - `run`, `scenario`: a run with a log, and its scenario.
    - `milliseconds`: computing time.
    """
    log, outcome = run.log, run.outcome
    assert log is not None
    signals: dict[str, Any] = {
        "q": log.state.q,
        "dq": log.state.dq,
        "q_d": log.reference.q,
        "e": log.e,
        "tau": log.tau,
    }
    bounds = _bounds(run, scenario)
    if bounds is not None:
        lower, upper = bounds
        inside = np.minimum(log.e - lower, upper - log.e) / (upper - lower)
        signals |= {"lower": lower, "upper": upper, "rho": np.maximum(upper, -lower), "margin": inside.min(axis=1)}
    if run.tally.promise is not None:
        signals["assumption_violated"] = np.asarray(log.signals["margin"]) < 0.0
    arrays = {"t": np.asarray(log.t, float)} | {name: np.asarray(values, float) for name, values in signals.items()}
    rows = len(arrays["t"])
    head = {
        "outcome": {"kind": outcome.kind, "message": outcome.message, "time": outcome.t, "joint": outcome.joint},
        "rows": rows,
        "signals": [{"name": name, "width": values.size // max(rows, 1)} for name, values in arrays.items()],
        "metrics": _finite(_dotted(summary(run, INDICES))),
        "milliseconds": milliseconds,
    }
    return head, b"".join(np.ascontiguousarray(values, "<f8").tobytes() for values in arrays.values())


def _bounds(run: Run, scenario: Scenario) -> tuple[np.ndarray, np.ndarray] | None:
    """The envelope of the error: the scheme's own, or what every scheme is judged by here."""
    log = run.log
    assert log is not None
    if log.envelope is not None:
        return np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
    if scenario.tolerance is None:
        return None
    import jax
    import jax.numpy as jnp

    tolerance = scenario.tolerance
    sides = tolerance.init(jnp.zeros(()), jnp.asarray(log.e[0]))
    bounds = jax.vmap(lambda t: tolerance.envelope(t, sides))(jnp.asarray(log.t))
    return np.asarray(bounds.lower), np.asarray(bounds.upper)


def _dotted(values: dict[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= _dotted(value, f"{before}{name}.")
        elif value is not None:
            flat[f"{before}{name}"] = value if isinstance(value, list) else [value]
    return flat


def _finite(values: dict[str, list[Any]]) -> dict[str, list[float | None]]:
    return {
        name: [None if number is None or not math.isfinite(number) else float(number) for number in entries]
        for name, entries in values.items()
    }
