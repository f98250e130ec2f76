"""The two arms at several periods, with and without delay, and after lost samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax import metrics

from .loops import loop, milliseconds, small, steady_error, steady_step, table, write_table

ARMS = ("example-4.1-1khz", "example-4.2-1khz")
ENDS = {"example-4.1-1khz": 10.0, "example-4.2-1khz": 12.0}
PERIODS = (1e-3, 2e-3, 1e-2, 1.1e-2)
LOST = 20
OUTAGES = (0.5, 8.0)
SAME = 2e-6
"""Two errors nearer than this are the same here [rad]."""


def _row(name: str, period: float, delay: int) -> list[str]:
    run = loop(name, period, {"sensor.delay": delay}, t1=ENDS[name]).simulate(log_every=None)
    settled = float(np.max(metrics.settling_time(run, 1e-3)))
    return [
        f"`{name}`",
        milliseconds(period),
        str(delay),
        str(metrics.envelope_violations(run)),
        f"{settled:.2f}",
        small(steady_error(run)),
        f"{np.max(metrics.peak_torque(run)):.0f}",
        f"{steady_step(run):.2g}",
    ]


def _outage(name: str, start: float, horizon: float | None) -> list[str]:
    changes: dict[str, Any] = {} if horizon is None else {"scheme.sampled_data.horizon": horizon}
    lost = {"sensor.loss.outages": [{"start": start, "samples": LOST}]}
    usual = loop(name, 1e-3, changes, t1=ENDS[name]).simulate(log_every=1)
    run = loop(name, 1e-3, changes | lost, t1=ENDS[name]).simulate(log_every=1)
    t = np.asarray(run.log.t)
    apart = np.max(np.abs(np.asarray(run.log.e) - np.asarray(usual.log.e)), axis=1)
    end = start + LOST * 1e-3
    far = np.flatnonzero(apart > SAME)
    return [
        f"`{name}`",
        f"{start:g}",
        milliseconds(float(run_horizon(name, horizon))),
        str(metrics.envelope_violations(run)),
        small(float(np.max(apart))),
        small(float(np.max(np.abs(np.asarray(run.log.e)[t >= 7.9])))),
        f"{1e3 * (t[far[-1]] - end):.0f}" if len(far) else "0",
    ]


def run_horizon(name: str, horizon: float | None) -> float:
    """The horizon of a scenario [s].

    - `name`: of the scenario.
    - `horizon`: the one asked for; None for the scenario's own.
    """
    return float(loop(name, 1e-3).controller.horizon) if horizon is None else horizon


def make() -> None:
    """Measures, and writes the tables."""
    rows = [_row(name, period, delay) for name in ARMS for period in PERIODS for delay in (0, 1)]
    head = [
        "arm", "h [ms]", "delay [h]", "samples outside", "settled [s]", "steady error [rad]", "peak torque [N m]",
        "torque step, steady [N m]",
    ]  # fmt: skip
    write_table("loop-rate.md", "periods", table(head, rows))
    rows = [_outage(name, start, horizon) for name in ARMS for start in OUTAGES for horizon in (0.003, None)]
    head = [
        "arm", "lost from [s]", "H [ms]", "samples outside", "farthest from the run without the loss [rad]",
        "peak error after 7.9 s [rad]", "as without the loss again after [ms]",
    ]  # fmt: skip
    write_table("loop-rate.md", "lost samples", table(head, rows))
