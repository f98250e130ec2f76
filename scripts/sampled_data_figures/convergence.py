"""How the errors grow with the period, of the printed law and of its sampled-data forms."""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from slidax import scenarios
from slidax.figures.style import LINES, WIDTH, legend_above, styled

from .loops import (
    BARE,
    loop,
    milliseconds,
    order,
    plain_numbers,
    save,
    small,
    smallest,
    steady_error,
    steady_step,
    table,
    write_table,
)

SCENARIO = "example-4.1"
# Not 2.5, 5 or 10 ms, at which samples meet the 100 Hz of the disturbance always in the same phase.
PERIODS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 4e-4, 7e-4, 1e-3, 1.5e-3, 2.2e-3, 3.1e-3, 4.3e-3, 6.1e-3, 8.3e-3, 1.1e-2)
PRINTED = (1e-5, 2e-5, 5e-5, 1e-4, 1.4e-4, 1.5e-4, 1.6e-4, 2e-4, 3e-4, 4e-4, 5e-4, 7e-4, 1e-3)
NEAR = (2e-5, 1e-4, 4e-4, 1e-3, 2e-3)
SHOWN = (1e-5, 1e-4, 4e-4, 1e-3, 2.2e-3, 4.3e-3, 1.1e-2)
LAWS = {
    "implicit, $H = h$, $s_0 = 0.05$": ({**BARE, "scheme.reaching.layer": 0.05}, True),
    "implicit, $H = h$, $s_0 = 0$": ({**BARE, "scheme.reaching.layer": 0.0}, True),
    "with estimate, $H = 12$ ms, $s_0 = 0$": (
        {"scheme.sampled_data": {"recovery": None}, "scheme.reaching.layer": 0.0},
        False,
    ),
}
AS_PRINTED = "as printed, $s_0 = 0.05$"
NAMES = (
    "as printed, s0 = 0.05",
    "implicit, H = h, s0 = 0.05",
    "implicit, H = h, s0 = 0",
    "with estimate, H = 12 ms, s0 = 0",
)


def _error(period: float, changes: dict[str, Any], follows: bool) -> float:
    horizon = {"scheme.sampled_data.horizon": period} if follows else {}
    return steady_error(loop(SCENARIO, period, changes | horizon).simulate(log_every=None))


def limit_of_hold() -> tuple[float, float, float]:
    """The predicted period of the limit cycle, that of the boundary layer, and the observed one [s]."""
    law = scenarios.load(SCENARIO).controller
    surface, ratio = law.surface, law.transformation
    slope = float(surface.pull_and_slope(jnp.zeros(2))[1][0])
    rate = slope * float((1.0 / ratio.overshoot + 1.0) / ratio.performance.final[0])
    scenario = scenarios.load(SCENARIO)
    goal = scenario.trajectory.reference(jnp.asarray(10.0)).q
    true, nominal = scenario.plant.robot.mass(goal), law.nominal.mass(goal)
    share = float(np.max(np.real(np.linalg.eigvals(np.linalg.solve(true, nominal)))))
    run = loop(SCENARIO, 1e-4).simulate(log_every=1)
    u = float(run.log.signals["u"][-1])
    layer = 2.0 * float(law.reaching.layer) * float(np.linalg.eigvalsh(true)[0]) / u
    smooth = steady_step(run) / 1e-4

    def cycles(h: float) -> bool:
        # The same number of samples for all, so that the loop is compiled once.
        return not steady_step(loop(SCENARIO, h, t1=70_000 * h).simulate(log_every=None)) < 20.0 * smooth * h

    return 2.0 / (share * rate), layer, smallest(cycles, 1.3e-4, 1.7e-4, 6)


def distance_to_printed() -> list[float]:
    """By how much the implicit law's errors differ from the printed law's within 2 s, for each period of NEAR [rad]."""
    every = 2e-3
    fine = scenarios.load(SCENARIO, {"simulation.period": 1e-5, "simulation.t1": 2.0})
    printed = np.asarray(fine.simulate(log_every=round(every / 1e-5)).log.e)
    distances = []
    for h in NEAR:
        changes = {**BARE, "scheme.sampled_data.horizon": h}
        run = loop(SCENARIO, h, changes, t1=2.0).simulate(log_every=round(every / h))
        distances.append(float(np.max(np.abs(np.asarray(run.log.e) - printed))))
    return distances


@styled
def draw(
    printed: list[float], errors: dict[str, list[float]], distances: list[float], predicted: float, observed: float
) -> Figure:
    """The picture: to the left steady errors over the period, to the right the distance to the printed law.

    - `printed`: steady errors of the printed law, for PRINTED.
    - `errors`: of the others by name, for PERIODS.
    - `distances`: for NEAR.
    - `predicted`, `observed`: period at which the limit cycle begins [s].
    """
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.75, 1])
    inside = [(1e3 * h, e) for h, e in zip(PRINTED, printed, strict=True) if not math.isnan(e)]
    handles = left.plot(*zip(*inside, strict=True), **LINES[1], marker="o", markersize=2.2, label=AS_PRINTED)
    left.plot(*inside[-1], marker="x", color=LINES[1]["color"], markersize=6, markeredgewidth=1.3)
    left.annotate(
        "leaves the\nenvelope", inside[-1], (7, 1), textcoords="offset points", va="center", color=LINES[1]["color"]
    )
    looks = (LINES[0], LINES[2], LINES[3])
    for (name, values), look in zip(errors.items(), looks, strict=True):
        handles += left.plot([1e3 * h for h in PERIODS], values, **look, marker="o", markersize=2.2, label=name)
    left.axvline(1e3 * predicted, color="0.45", linewidth=0.7, linestyle=(0, (3, 2)))
    left.annotate(
        f"limit cycle:\npredicted {1e3 * predicted:.3f} ms\nobserved {1e3 * observed:.3f} ms",
        (1e3 * predicted, 6e-6), (-5, 0), textcoords="offset points", ha="right", va="center", fontsize=8,
    )  # fmt: skip
    left.set_ylabel("steady error  [rad]")
    left.set_ylim(1e-10, 2e-3)
    right.plot([1e3 * h for h in NEAR], distances, **LINES[0], marker="o", markersize=2.2)
    start = 0.45 * distances[0]
    right.plot([1e-2, 2.0], [start, 200 * start], color="0.45", linewidth=0.7)
    right.annotate("order 1", (0.14, 14 * start), (3, -9), textcoords="offset points", fontsize=8)
    right.set_ylabel("distance to the printed law  [rad]")
    for axes, ticks in ((left, (0.01, 0.1, 1, 10)), (right, (0.01, 0.1, 1))):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("$h$  [ms]")
        plain_numbers(axes, ticks)
    left.set_xlim(0.8e-2, 15)
    right.set_xlim(0.8e-2, 2.6)
    legend_above(figure, handles, 2)
    return figure


def make() -> None:
    """Measures, and writes the figure and its tables."""
    printed = [steady_error(loop(SCENARIO, h).simulate(log_every=None)) for h in PRINTED]
    # All laws at one period after each other: they share what is compiled.
    found = [[_error(h, changes, follows) for changes, follows in LAWS.values()] for h in PERIODS]
    errors = {name: [row[i] for row in found] for i, name in enumerate(LAWS)}
    predicted, layer, observed = limit_of_hold()
    distances = distance_to_printed()
    save(draw(printed, errors, distances, predicted, observed), "convergence")

    known = dict(zip(PRINTED, printed, strict=True))
    columns = list(errors.values())
    rows = [
        [milliseconds(h), "left" if math.isnan(known.get(h, math.nan)) else small(known[h])]
        + [small(column[PERIODS.index(h)]) for column in columns]
        for h in SHOWN
    ]
    ranges = ((1e-5, 1e-4), (4e-4, 2.2e-3), (3.1e-3, 1.1e-2))
    for low, high in ranges:
        orders = [f"{order(PERIODS, column, low, high):.1f}" for column in columns]
        rows.append([f"order, {milliseconds(low)} to {milliseconds(high)}", "-", *orders])
    write_table("sampled-data.md", "steady errors", table(["h [ms]", *NAMES], rows))

    rows = [[milliseconds(h), small(d)] for h, d in zip(NEAR, distances, strict=True)]
    rows.append(["order", f"{order(NEAR, distances, NEAR[0], NEAR[-1]):.2f}"])
    write_table("sampled-data.md", "distance", table(["h [ms]", "max abs(e - e of the printed law) [rad]"], rows))
    head = ["the printed law's period must be below", "[ms]"]
    rows = [
        ["`2/(λmax(M⁻¹M0) λ)`", f"{1e3 * predicted:.3f}"],
        ["`2 s0 λmin(M)/u`, the boundary layer's", f"{1e3 * layer:.1f}"],
        ["observed: steady torque steps grow by more than 20 times", f"{1e3 * observed:.3f}"],
    ]
    write_table("sampled-data.md", "limit", table(head, rows))
