"""The loop-rate rule beside the smallest envelope that holds in simulations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.optimize import brentq

from slidax.controllers import SampledData
from slidax.figures.style import LINES, WIDTH, legend_above, styled
from slidax.scenarios.scenario import Scenario
from slidax.transformations.psi import Sides, psi

from .loops import BARE, loop, milliseconds, plain_numbers, save, small, smallest, table, write_table

PUSH = (6.0, -6.0)
"""Torque that nothing knows of, towards the near bound of both joints [N m]."""
CONSTANT: dict[str, Any] = BARE | {
    "robot.nominal": {},
    "disturbance.terms": [{"kind": "constant", "value": list(PUSH)}],
    "scheme.reaching.layer": 0.0,
}
PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
SHOWN = (1e-3, 8e-3)
CASES = ((1, 0), (1, 1), (6, 1))
"""Horizon in periods, and delay in periods."""
ARMS = {"example-4.1-1khz": "two-link arm", "example-4.2-1khz": "SCARA"}
ARM_PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 1.1e-2)


def radius_needed(law: SampledData, push: float) -> float:
    """The final radius of the rule, `(H + D h)² w/(β - ψ(ε̄))` [rad].

    - `law`: with its period, horizon, delay, surface and overshoot.
    - `push`: w, largest acceleration that the estimate misses [rad/s²].
    """
    h, horizon, delay = float(law.period), float(law.horizon), law.delay
    square = (horizon + delay * h) ** 2
    return square * push / (float(law.step.transformation.overshoot) * (1.0 - taken(law, push)))


def taken(law: SampledData, push: float) -> float:
    """What ψ(ε̄) takes of the overshoot, a share.

    - `law`, `push`: as above.
    """
    h, horizon, delay = float(law.period), float(law.horizon), law.delay
    target = (2.0 if delay else 1.0) * (horizon + delay * h) ** 2 / horizon * push
    side = float(law.step.transformation.overshoot)
    sides = Sides(jnp.asarray(-1.0), jnp.asarray(side))
    pull = law.step.surface.pull_and_slope
    eps = brentq(lambda x: float(np.max(pull(jnp.full(law.joints, x))[0])) - target, 0.0, 1e3)
    return float(psi(jnp.asarray(eps), sides)) / side


def residual(scenario: Scenario, since: float = 5.0) -> float:
    """w: the largest `|residual|` plus D times the largest change of `push` in a run, from some time on [rad/s²].

    - `scenario`: of a sampled-data law.
    - `since`: from when [s].
    """
    log = scenario.simulate(log_every=1).log
    late = np.asarray(log.t)[1:] > since
    missed = np.abs(np.asarray(log.signals["residual"]))[1:]
    changed = np.abs(np.diff(np.asarray(log.signals["push"]), axis=0))
    return float(np.max((missed + scenario.controller.delay * changed)[late]))


def _smallest_radius(
    name: str, period: float, changes: dict[str, Any], low: float, high: float, halvings: int
) -> float:
    def holds(radius: float) -> bool:
        scenario = loop(name, period, changes | {"scheme.performance.final": radius})
        return scenario.simulate(log_every=None).outcome.ok

    return smallest(holds, low, high, halvings)


def constant_push(horizon: int, delay: int) -> tuple[list[float], list[float]]:
    """The rule's radius and the smallest one that holds under a constant push, for each of PERIODS [rad].

    - `horizon`, `delay`: in periods.
    """
    rule, held = [], []
    for h in PERIODS:
        changes = CONSTANT | {"scheme.sampled_data.horizon": horizon * h, "sensor.delay": delay}
        scenario = loop("example-4.1", h, changes)
        mass = scenario.plant.robot.mass(scenario.trajectory.reference(jnp.asarray(10.0)).q)
        push = float(np.max(np.abs(np.linalg.solve(mass, np.asarray(PUSH)))))
        rule.append(radius_needed(scenario.controller, push))
        held.append(_smallest_radius("example-4.1", h, changes, 0.5 * rule[-1], 1.05 * rule[-1], 7))
    return rule, held


@dataclass(frozen=True)
class Rate:
    """An arm at one period.

    - `horizon`: H [s].
    - `push`: w [rad/s²].
    - `share`: of the overshoot that ψ(ε̄) takes.
    - `rule`, `held`: final radius by the rule, and the smallest one that holds [rad].
    """

    horizon: float
    push: float
    share: float
    rule: float
    held: float


def of_arm(name: str, period: float) -> Rate:
    """What a built-in scenario at 1 kHz needs at another period.

    - `name`: of the scenario.
    - `period`: h [s].
    """
    scenario = loop(name, period)
    push = residual(scenario)
    rule = radius_needed(scenario.controller, push)
    return Rate(
        horizon=float(scenario.controller.horizon),
        push=push,
        share=taken(scenario.controller, push),
        rule=rule,
        held=_smallest_radius(name, period, {}, rule / 300.0, 2.0 * rule, 7),
    )


@styled
def draw(pushed: dict[tuple[int, int], tuple[list[float], list[float]]], arms: dict[str, list[Rate]]) -> Figure:
    """The picture: final radius over the period, to the left under a constant push, to the right the two arms.

    - `pushed`: by horizon and delay in periods, the rule and what was found.
    - `arms`: by name of the scenario, for each of ARM_PERIODS.
    """
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    for ((horizon, delay), (rule, held)), look in zip(pushed.items(), LINES, strict=False):
        h = [1e3 * period for period in PERIODS]
        left.plot(h, [1e3 * r for r in rule], **{**look, "linestyle": "-" if delay == 0 else (0, (5, 1.6))})
        left.plot(h, [1e3 * r for r in held], "o", color=look["color"], markersize=3.4)
        name = "$H = h$" if horizon == 1 else f"$H = {horizon}\\,h$"
        left.annotate(
            name + (", delay $h$" if delay else ""), (h[3], 1e3 * rule[3]), (-5, 4),
            textcoords="offset points", ha="right", color=look["color"], fontsize=8,
        )  # fmt: skip
    for (name, rates), look in zip(arms.items(), LINES, strict=False):
        h = [1e3 * period for period in ARM_PERIODS]
        right.plot(h, [1e3 * rate.rule for rate in rates], **{**look, "linestyle": "-"})
        right.plot(h, [1e3 * rate.held for rate in rates], "o", color=look["color"], markersize=3.4)
        place = (0, 11) if name == "example-4.1-1khz" else (10, -13)
        right.annotate(
            ARMS[name], (h[1], 1e3 * rates[1].rule), place, textcoords="offset points", color=look["color"], fontsize=8
        )
    left.set_title("constant push, no estimate")
    right.set_title("the two arms at their own disturbance")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("$h$  [ms]")
        plain_numbers(
            axes, (0.5, 1, 2, 4, 8) if axes is left else (0.5, 1, 2, 4, 11), (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1, 10)
        )
    left.set_xlim(0.42, 9)
    left.set_ylim(9e-4, 40)
    right.set_ylim(9e-4, 40)
    right.set_xlim(0.44, 12.5)
    left.set_ylabel(r"$\rho_\infty$  [mrad]")
    handles = [
        Line2D([], [], color="0.3", label="the loop-rate rule"),
        Line2D(
            [], [], marker="o", linestyle="", color="0.3", markersize=3.4, label="smallest that holds in simulation"
        ),
    ]
    legend_above(figure, handles)
    return figure


def make() -> None:
    """Measures, and writes the figure and its tables."""
    pushed = {case: constant_push(*case) for case in CASES}
    arms = {name: [of_arm(name, period) for period in ARM_PERIODS] for name in ARMS}
    save(draw(pushed, arms), "loop-rate")
    rows = [
        [
            ("H = h" if horizon == 1 else f"H = {horizon} h") + (", delay h" if delay else ""),
            milliseconds(h),
            small(rule),
            f"{held / rule:.3f}",
        ]
        for (horizon, delay), found in pushed.items()
        for h, rule, held in zip(PERIODS, *found, strict=True)
        if h in SHOWN
    ]
    head = ["constant push", "h [ms]", "ρ∞ by the rule [rad]", "smallest that held, over it"]
    write_table("loop-rate.md", "constant push", table(head, rows))
    rows = [
        [
            name,
            milliseconds(h),
            milliseconds(rate.horizon),
            f"{rate.push:.2g}",
            f"{100.0 * rate.share:.2g} %",
            small(rate.rule),
            small(rate.held),
        ]
        for name, rates in arms.items()
        for h, rate in zip(ARM_PERIODS, rates, strict=True)
    ]
    head = ["arm", "h [ms]", "H [ms]", "w̄ [rad/s²]", "ψ(ε̄) of ϑ", "ρ∞ by the rule [rad]", "smallest ρ∞ that held [rad]"]
    write_table("loop-rate.md", "rule", table(head, [[f"`{row[0]}`", *row[1:]] for row in rows]))
