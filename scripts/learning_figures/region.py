"""Which wrong inertia the loop of a joint bears: by its linear form, and in simulation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from sampled_data_figures.loops import plain_numbers, save, table, write_table

from slidax import scenarios
from slidax.diagnosis.linear_loop import LinearLoop
from slidax.estimators.steady_gains import steady_gains
from slidax.figures.style import LINES, NARROW, WIDTH, styled

HORIZONS = np.array([3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0])
DELAYS = (0, 1, 2, 3)
PACES = (0.7, 1.4, 2.8)
"""ω H of the estimator."""

CHECKED = (5.0, 10.0, 20.0)
VARIANCE = 1e-12
HEAVY = 50.0
"""kg m² of each rotor in the simulated arm, beside which its links hardly count."""


def loop(horizon: float, delay: float, pace: float) -> LinearLoop:
    """The loop of a joint with a Kalman filter.

    - `horizon`: H [periods].
    - `delay`: D [periods].
    - `pace`: ω H of the filter.
    """
    ratio = (pace / horizon) ** 6
    first, second, third = (float(one) for one in steady_gains(ratio, 1.0, 1.0))
    return LinearLoop(1.0, horizon, float(delay), (first, second, third), measures_velocity=False)


def simulated_range(horizon: float, delay: int, pace: float) -> tuple[float, float]:
    """The κ for which a simulated joint comes to rest.

    - `horizon`, `delay`, `pace`: as in `loop`.
    """
    ends = []
    for start, beyond in ((1.0, 64.0), (1.0, 1.0 / 64.0)):
        inside, outside = start, beyond
        for _ in range(7):
            middle = math.sqrt(inside * outside)
            if _rests(horizon, delay, pace, middle):
                inside = middle
            else:
                outside = middle
        ends.append(math.sqrt(inside * outside))
    return ends[1], ends[0]


def _rests(horizon: float, delay: int, pace: float, kappa: float) -> bool:
    posture = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    believed = kappa * HEAVY
    h = 1e-3
    density = (pace / horizon) ** 6 * VARIANCE / h**5 * believed**2
    changes: dict[str, Any] = {
        "robot": {
            "kind": "panda",
            "nominal": {"armature": [HEAVY] * 6 + [believed]},
            "plant": {"armature": HEAVY},
        },
        "trajectory": {"kind": "constant", "value": posture},
        "sensor": {"resolution": 1e-10, "velocity": "differenced", "delay": delay},
        "actuator": {},
        "start.q": [*posture[:6], posture[6] + 1e-4],
        "scheme.transformation.performance.final": 0.9,
        "scheme.surface.k1": 50.0,
        "scheme.sampled_data": {
            "horizon": horizon * h,
            "estimator": {"kind": "kalman", "torque_density": density, "variance": VARIANCE},
            "adaptation": None,
        },
        "simulation.t1": 2.0,
    }
    run = scenarios.load("panda-payload", changes).simulate(log_every=1, progress=False)
    error = np.abs(np.asarray(run.log.e)[:, 6])
    return bool(np.isfinite(error[-1]) and error[-200:].max() < 1e-5)


@styled
def draw() -> Figure:
    """The picture: the bounds of κ over the horizon, for each delay, and for each pace of the estimator."""
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    by_delay, by_pace = figure.subplots(1, 2, sharey=True)
    for look, delay in zip(LINES, DELAYS, strict=False):
        _draw_range(by_delay, [loop(h, delay, 1.4) for h in HORIZONS], look, f"D = {delay}")
    for look, pace in zip(LINES, PACES, strict=False):
        _draw_range(by_pace, [loop(h, 1, pace) for h in HORIZONS], look, f"ωH = {pace:g}")
    for axes, title in ((by_delay, "ωH = 1.4, delays of D periods"), (by_pace, "a delay of one period")):
        axes.set_xscale("log")
        axes.set_yscale("log")
        plain_numbers(axes, [3, 5, 10, 20, 30], [0.2, 0.3, 0.5, 1.0, 2.0, 3.0, 5.0])
        axes.axhline(1.0, **NARROW)
        axes.set_xlabel("horizon H over the period")
        axes.set_title(title)
        axes.legend(loc="upper right", ncols=2)
        axes.set_ylim(0.2, 6.0)
    by_delay.set_ylabel("κ, believed over true inertia")
    return figure


def _draw_range(axes: Any, loops: list[LinearLoop], look: dict[str, Any], label: str) -> None:
    ranges = np.array([one.stable_range() for one in loops])
    axes.plot(HORIZONS, ranges[:, 0], **look, label=label)
    axes.plot(HORIZONS, ranges[:, 1], **look)


def make() -> None:
    """Writes the picture, and the table that compares it with simulations."""
    save(draw(), "inertia-region")
    rows = []
    for delay in (0, 1, 3):
        for horizon in CHECKED:
            linear = loop(horizon, delay, 1.4).stable_range()
            found = simulated_range(horizon, delay, 1.4)
            rows.append([f"{delay}", f"{horizon:g}", *(f"{x:.2g}" for x in (*linear, *found))])
    head = ["D", "H/h", "κ from", "to", "simulated, from", "to"]
    write_table("learning.md", "region", table(head, rows))
