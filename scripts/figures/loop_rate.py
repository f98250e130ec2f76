"""Figures and tables of docs/loop-rate.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.optimize import brentq

from slidax import analysis, scenarios
from slidax.law import SampledData
from slidax.law.error_transformations import Sides, psi
from slidax.plant import TRACES
from slidax.report.figures.style import LINES, WIDTH, legend_above, styled
from slidax.scenarios.scenario import Scenario

from .defaults import SCENARIOS
from .shared import (
    BARE,
    loop,
    milliseconds,
    plain_numbers,
    save,
    small,
    smallest,
    steady_error,
    steady_step,
    table,
    write_table,
)

PUSH = (6.0, -6.0)
"""Unknown torque towards the near bound of both joints [N m]."""
CONSTANT: dict[str, Any] = BARE | {
    "robot.nominal": {},
    "disturbance.terms": [{"kind": "constant", "value": list(PUSH)}],
    "scheme.reaching.layer": 0.0,
}
RULE_PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
SHOWN = (1e-3, 8e-3)
CASES = ((1, 0), (1, 1), (6, 1))
"""Horizon in periods, and delay in periods."""
TITLES = {"example-4.1-1khz": "two-link arm", "example-4.2-1khz": "SCARA"}
ARM_PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 1.1e-2)


def radius_needed(law: SampledData, disturbance: float) -> float:
    """The final radius of the rule, `(H + D h)² w/(β - ψ(ε̄))` [rad].

    - `law`: with its period, horizon, delay, surface and overshoot.
    - `disturbance`: w, largest acceleration that the estimate misses [rad/s²].
    """
    h, horizon, delay = float(law.period), float(law.horizon), law.delay
    square = (horizon + delay * h) ** 2
    return square * disturbance / (float(law.step.transformation.overshoot) * (1.0 - taken(law, disturbance)))


def taken(law: SampledData, disturbance: float) -> float:
    """Share of the overshoot that ψ(ε̄) takes."""
    h, horizon, delay = float(law.period), float(law.horizon), law.delay
    target = (2.0 if delay else 1.0) * (horizon + delay * h) ** 2 / horizon * disturbance
    side = float(law.step.transformation.overshoot)
    sides = Sides(jnp.asarray(-1.0), jnp.asarray(side))
    phi = law.step.surface.phi_and_slope
    eps = brentq(lambda x: float(np.max(phi(jnp.full(law.joints, x))[0])) - target, 0.0, 1e3)
    return float(psi(jnp.asarray(eps), sides)) / side


def residual(scenario: Scenario, since: float = 5.0) -> float:
    """w: the largest `|residual|` plus D times the largest change of `disturbance`, from some time on [rad/s²].

    - `since`: from when [s].
    """
    log = scenario.simulate(log_every=1).log
    late = np.asarray(log.t)[1:] > since
    missed = np.abs(np.asarray(log.signals["residual"]))[1:]
    changed = np.abs(np.diff(np.asarray(log.signals["disturbance"]), axis=0))
    return float(np.max((missed + scenario.controller.delay * changed)[late]))


def _smallest_radius(
    name: str, period: float, changes: dict[str, Any], low: float, high: float, halvings: int
) -> float:
    def holds(radius: float) -> bool:
        scenario = loop(name, period, changes | {"scheme.performance.final": radius})
        return scenario.simulate(log_every=None).outcome.ok

    return smallest(holds, low, high, halvings)


def constant_push(horizon: int, delay: int) -> tuple[list[float], list[float]]:
    """The rule's radius and the smallest one that holds under a constant disturbance, for each of PERIODS [rad]."""
    rule, held = [], []
    for h in RULE_PERIODS:
        changes = CONSTANT | {"scheme.sampled_data.horizon": horizon * h, "sensor.delay": delay}
        scenario = loop("example-4.1", h, changes)
        mass = scenario.plant.robot.mass(scenario.trajectory.reference(jnp.asarray(10.0)).q)
        disturbance = float(np.max(np.abs(np.linalg.solve(mass, np.asarray(PUSH)))))
        rule.append(radius_needed(scenario.controller, disturbance))
        held.append(_smallest_radius("example-4.1", h, changes, 0.5 * rule[-1], 1.05 * rule[-1], 7))
    return rule, held


@dataclass(frozen=True)
class Rate:
    """An arm at one period.

    - `horizon`: H [s].
    - `disturbance`: w [rad/s²].
    - `share`: of the overshoot that ψ(ε̄) takes.
    - `rule`, `held`: final radius by the rule, and the smallest one that holds [rad].
    """

    horizon: float
    disturbance: float
    share: float
    rule: float
    held: float


def of_arm(name: str, period: float) -> Rate:
    """Requirements of a built-in scenario at another period.

    - `period`: h [s].
    """
    scenario = loop(name, period)
    disturbance = residual(scenario)
    rule = radius_needed(scenario.controller, disturbance)
    return Rate(
        horizon=float(scenario.controller.horizon),
        disturbance=disturbance,
        share=taken(scenario.controller, disturbance),
        rule=rule,
        held=_smallest_radius(name, period, {}, rule / 300.0, 2.0 * rule, 7),
    )


@styled
def draw_loop_rate(
    pushed: dict[tuple[int, int], tuple[list[float], list[float]]], arms: dict[str, list[Rate]]
) -> Figure:
    """The picture: final radius over the period, to the left under a constant disturbance, to the right the two arms.

    - `pushed`: by horizon and delay in periods, the rule and what was found.
    - `arms`: by name of the scenario, for each of ARM_PERIODS.
    """
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    for ((horizon, delay), (rule, held)), look in zip(pushed.items(), LINES, strict=False):
        h = [1e3 * period for period in RULE_PERIODS]
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
            TITLES[name],
            (h[1], 1e3 * rates[1].rule),
            place,
            textcoords="offset points",
            color=look["color"],
            fontsize=8,
        )
    left.set_title("constant disturbance, no estimate")
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


def write_loop_rate() -> None:
    """Measure, and write the figure and its tables."""
    pushed = {case: constant_push(*case) for case in CASES}
    arms = {name: [of_arm(name, period) for period in ARM_PERIODS] for name in TITLES}
    save(draw_loop_rate(pushed, arms), "loop-rate")
    rows = [
        [
            ("H = h" if horizon == 1 else f"H = {horizon} h") + (", delay h" if delay else ""),
            milliseconds(h),
            small(rule),
            f"{held / rule:.3f}",
        ]
        for (horizon, delay), radii in pushed.items()
        for h, rule, held in zip(RULE_PERIODS, *radii, strict=True)
        if h in SHOWN
    ]
    head = ["constant disturbance", "h [ms]", "ρ∞ by the rule [rad]", "smallest that held, over it"]
    write_table("loop-rate.md", "constant disturbance", table(head, rows))
    rows = [
        [
            name,
            milliseconds(h),
            milliseconds(rate.horizon),
            f"{rate.disturbance:.2g}",
            f"{100.0 * rate.share:.2g} %",
            small(rate.rule),
            small(rate.held),
        ]
        for name, rates in arms.items()
        for h, rate in zip(ARM_PERIODS, rates, strict=True)
    ]
    head = ["arm", "h [ms]", "H [ms]", "w̄ [rad/s²]", "ψ(ε̄) of ϑ", "ρ∞ by the rule [rad]", "smallest ρ∞ that held [rad]"]
    write_table("loop-rate.md", "rule", table(head, [[f"`{row[0]}`", *row[1:]] for row in rows]))


TRIED_ARMS = ("example-4.1-1khz", "example-4.2-1khz")
ENDS = {"example-4.1-1khz": 10.0, "example-4.2-1khz": 12.0}
TRIED_PERIODS = (1e-3, 2e-3, 1e-2, 1.1e-2)
LOST = 20
OUTAGES = (0.5, 8.0)
SAME = 2e-6
"""Two errors nearer than this are the same here [rad]."""


def _row(name: str, period: float, delay: int) -> list[str]:
    run = loop(name, period, {"sensor.delay": delay}, t1=ENDS[name]).simulate(log_every=None)
    settled = float(np.max(analysis.settling_time(run, 1e-3)))
    return [
        f"`{name}`",
        milliseconds(period),
        str(delay),
        str(analysis.envelope_violations(run)),
        f"{settled:.2f}",
        small(steady_error(run)),
        f"{np.max(analysis.peak_torque(run)):.0f}",
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
        str(analysis.envelope_violations(run)),
        small(float(np.max(apart))),
        small(float(np.max(np.abs(np.asarray(run.log.e)[t >= 7.9])))),
        f"{1e3 * (t[far[-1]] - end):.0f}" if len(far) else "0",
    ]


def run_horizon(name: str, horizon: float | None) -> float:
    """The horizon of a scenario [s].

    - `horizon`: the one asked for; None for the scenario's own.
    """
    return float(loop(name, 1e-3).controller.horizon) if horizon is None else horizon


def write_periods() -> None:
    """Measure, and write the tables."""
    rows = [_row(name, period, delay) for name in TRIED_ARMS for period in TRIED_PERIODS for delay in (0, 1)]
    head = [
        "arm", "h [ms]", "delay [h]", "samples outside", "settled [s]", "steady error [rad]", "peak torque [N m]",
        "torque step, steady [N m]",
    ]  # fmt: skip
    write_table("loop-rate.md", "periods", table(head, rows))
    rows = [_outage(name, start, horizon) for name in TRIED_ARMS for start in OUTAGES for horizon in (0.003, None)]
    head = [
        "arm", "lost from [s]", "H [ms]", "samples outside", "farthest from the run without the loss [rad]",
        "peak error after 7.9 s [rad]", "as without the loss again after [ms]",
    ]  # fmt: skip
    write_table("loop-rate.md", "lost samples", table(head, rows))


LAWS = ("cftsmppc", "slotine_li_ppc", "slotine_li", "super_twisting", "computed_torque", "gravity_pd")


def _timed(arm: str, law: str, trace: str | None) -> str:
    """Samples outside of the scenario's envelope, and the steady error [rad]."""
    final = float(scenarios.load(arm).controller.step.transformation.performance.final)
    performance = {"kind": "fixed_time", "initial": 1.0, "final": final, "deadline": 2.0, "exponent": 2.01}
    changes: dict[str, Any] = {
        "sensor.loss.trace": trace,
        "tolerance": {"performance": performance, "overshoot": 0.3},
    }
    run = scenarios.load(arm, changes if law == "cftsmppc" else {**changes, "scheme.name": law}).simulate(
        log_every=None, progress=False
    )
    return f"{analysis.tolerance_violations(run)}, {small(steady_error(run))}" if run.outcome.ok else "leaves"


def write_timing() -> None:
    """Simulate laws under the timing traces of controller managers, and write the table of docs/loop-rate.md."""
    traces = (None, *TRACES)
    rows = [
        [arm.removesuffix("-payload"), f"`{law}`", *(_timed(arm, law, trace) for trace in traces)]
        for arm in SCENARIOS
        for law in LAWS
    ]
    head = ["arm", "law", "on time", *(f"`{name}`" for name in TRACES)]
    write_table("loop-rate.md", "timing", table(head, rows))
