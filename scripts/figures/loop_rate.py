"""Figures and tables of docs/loop-rate.md, and the table of default gains in docs/sampled-data.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.optimize import brentq

from slidax import analysis, scenarios
from slidax.arms import Articulated, Mismatch, Payload, TimedPayload
from slidax.core import Scalar, State, Vector
from slidax.law import SampledData
from slidax.law.error_transformations import Sides, psi
from slidax.plant import TRACES, Step
from slidax.report.figures.style import LINES, WIDTH, legend_above, styled
from slidax.scenarios.scenario import Scenario
from slidax.simulation import Parts, Plant, Run, simulate_batch

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


SCENARIOS = ("panda-payload", "ur5e-payload")
RATES = (50, 100, 250, 500, 1000)
DELAYS = (0, 1, 2, 3)
SENSORS: dict[str, dict[str, Any]] = {
    "encoders": {"resolution": 1e-5, "velocity": "differenced"},
    "velocity sensor": {"velocity": "measured"},
}
CHANGES = ("nothing", "half the torque", "2 kg grasped", "disturbance")

CHANGE, END, WINDOW = 3.0, 12.0, 3.0
"""Time of the change, end of the run, and length of its last windows [s]."""

WEIGHT = 20.0
"""rad/s²: about the acceleration of a wrist of 0.1 kg m² by 2 kg at 0.1 m from its axis."""

GROWTH = 2.0
"""An error grows if it is larger in the last window than in the one before by this factor."""

HEAVIEST, BEFORE_GRASP = 3.0, {"panda-payload": 1.0, "ur5e-payload": 3.0}
"""kg: largest payload, and largest one to which 2 kg are added; these arms are rated for 3 kg and 5 kg."""

SHARE_NEEDED = 0.4
"""Only a joint whose motion takes no more of its torque limit can lose half of its torque and still follow."""


class Weakened(Plant):
    """A plant whose drives deliver only a share of their torque from a time on."""

    share: Vector = eqx.field(kw_only=True)
    since: Scalar = eqx.field(kw_only=True)

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """The acceleration under the delivered torque [n], rad/s² or m/s².

        - `t`: time [s].
        - `tau`: torque of intact drives [n], N m or N.
        """
        return super().acceleration(t, state, jnp.where(t >= self.since, self.share * tau, tau))


@dataclass(frozen=True)
class Setting:
    """An arm with its default gains.

    - `scenario`: name of the built-in scenario that has the arm, its motion and its envelope.
    - `rate`: samples per second.
    - `sensor`: one of `SENSORS`.
    - `delay`: age of a measurement [periods].
    - `sampled_data`: settings of that block; empty for all defaults.
    """

    scenario: str
    rate: int
    sensor: str
    delay: float
    sampled_data: tuple[tuple[str, Any], ...] = ()

    def load(self) -> Scenario:
        """The scenario, with the default bound as well."""
        period = 1.0 / self.rate
        return scenarios.load(
            self.scenario,
            {
                "scheme.sampled_data": dict(self.sampled_data),
                "scheme.bound": {},
                "sensor": {**SENSORS[self.sensor], "delay": self.delay},
                "simulation.period": period,
                "simulation.substeps": max(2, round(period / 1e-3)),
                "simulation.t1": END,
            },
        )


def draw(scenario: Scenario, arms: int, seed: int, changes: tuple[str, ...] = CHANGES) -> dict[str, Array]:
    """Random arms, each with each change: masses, payload, friction, and the affected joint.

    - `scenario`: whose nominal arm and motion they have.
    """
    random = np.random.default_rng(seed)
    n = scenario.plant.robot.joints
    limit = np.broadcast_to(np.asarray(scenario.plant.actuator.limits.torque), (n,))
    rows = []
    for _ in range(arms):
        own = {
            "mass_factor": random.uniform(0.8, 1.2),
            "coulomb": random.uniform(0.1, 0.5, n),
            "viscous": random.uniform(0.05, 0.4, n),
        }
        filled, order, pushed, side = (
            random.uniform(),
            random.permutation(n),
            random.integers(n),
            random.choice([-1, 1]),
        )
        for change in changes:
            grasps = change == "2 kg grasped"
            row = own | {
                "payload": filled * (BEFORE_GRASP[scenario.name] if grasps else HEAVIEST),
                "grasped": 2.0 if grasps else 0.0,
                "share": np.ones(n),
                "disturbance": np.zeros(n),
            }
            if change == "half the torque":
                needed = _needed(scenario, row)
                row["share"][next(j for j in order if needed[j] < SHARE_NEEDED * limit[j])] = 0.5
            if change == "disturbance":
                row["disturbance"][pushed] = side * 0.3 * limit[pushed]
            rows.append(row)
    return {name: jnp.asarray(np.stack([row[name] for row in rows])) for name in rows[0]}


def simulated(setting: Setting, arms: int, seed: int, changes: tuple[str, ...] = CHANGES) -> Run:
    """The runs of a setting: each arm with each change in turn."""
    scenario = setting.load()

    def define(row: dict[str, Array]) -> Parts:
        _, controller, trajectory, start = scenario.parts
        return _plant(scenario, row), controller, trajectory, start

    every = max(1, round(0.004 * setting.rate))
    drawn = draw(scenario, arms, seed, changes)
    return simulate_batch(define, drawn, t1=END, stepping=scenario.stepping, log_every=every)


def largest_errors(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest error of any joint [rad] in each of the last three windows, for each run; inf if not finite."""
    t, log = np.asarray(run.log.t)[0], run.log
    error = np.abs(np.asarray(log.state.q) - np.asarray(log.reference.q)).max(axis=-1)
    error = np.where(np.asarray(log.valid) & np.isfinite(error), error, np.inf)
    starts = [END - k * WINDOW for k in (3, 2, 1)]
    first, second, third = (error[:, (t >= start) & (t <= start + WINDOW)].max(axis=1) for start in starts)
    return first, second, third


def allowed_error(law: SampledData, final: float) -> float:
    """The final radius, and what the loop-rate rule adds for an unexplained acceleration of `WEIGHT` [rad].

    - `final`: ρ∞ of its envelope [rad].
    """
    return final + float(law.horizon + law.delay * law.period) ** 2 * WEIGHT


def diverging(setting: Setting, run: Run) -> np.ndarray:
    """True for each run that diverges.

    At the end of the run, 9 s after the change, its error is not finite, or larger than `allowed_error`, or grows: it
    is outside the final radius, `GROWTH` times that of the window before, and that one is larger than the one before
    it. One growing window is no sign: the motion's sinusoids beat, and the error with them.
    """
    scenario = setting.load()
    final = float(scenario.description.scheme.transformation.performance.final)
    first, before, last = largest_errors(run)
    grows = (last > GROWTH * before) & (before > first) & (last > final)
    return (last > allowed_error(scenario.controller, final)) | grows


def _plant(scenario: Scenario, row: dict[str, Any]) -> Weakened:
    own = scenario.plant
    center = jnp.array([0.0, 0.0, 0.1])
    mismatch = Mismatch(mass_factor=row["mass_factor"], coulomb=row["coulomb"], viscous=row["viscous"])
    nominal: Articulated = scenario.controller.nominal
    carrying = eqx.tree_at(
        lambda arm: arm.payload, mismatch.applied(nominal), Payload(row["payload"], center, 0.002 * row["payload"])
    )
    grasped = TimedPayload(Payload(row["grasped"], center, 0.002 * row["grasped"]), attached=CHANGE)
    disturbance = Step(row["disturbance"], CHANGE, CHANGE + 0.1)
    since = jnp.asarray(CHANGE)
    return Weakened(
        carrying, disturbance, own.sensor, own.actuator, grasped, share=jnp.asarray(row["share"]), since=since
    )


def _needed(scenario: Scenario, row: dict[str, Any]) -> np.ndarray:
    """Largest torque of the motion [n], N m or N."""
    times = jnp.linspace(2.0, END, 150)
    return np.asarray(_torques(_plant(scenario, row).robot, scenario.trajectory, times)).max(axis=0)


@eqx.filter_jit
def _torques(arm: Articulated, trajectory: Any, times: Array) -> Array:
    def at(t: Scalar) -> Vector:
        now = trajectory.reference(t)
        return jnp.abs(arm.mass(now.q) @ now.ddq + arm.bias(now.q, now.dq) + arm.friction(now.dq))

    return jax.vmap(at)(times)


ARMS_DRAWN = 10
SEED = 38


def write_defaults() -> None:
    """Write the table of default gains of docs/sampled-data.md, from 3200 runs."""
    rows = []
    for rate in RATES:
        for delay in DELAYS:
            row, count, horizon = [], 0, 0.0
            for sensor in SENSORS:
                largest = []
                for name in SCENARIOS:
                    setting = Setting(name, rate, sensor, delay)
                    run = simulated(setting, ARMS_DRAWN, SEED)
                    count += int(np.sum(diverging(setting, run)))
                    horizon = 1e3 * float(setting.load().controller.horizon)
                    largest.append(largest_errors(run)[2].reshape(ARMS_DRAWN, len(CHANGES)).max(axis=0))
                row += [f"{x:.1e}" for x in np.max(largest, axis=0)]
            rows.append([f"{rate}", f"{delay}", f"{horizon:.3g}", *row, f"{count}"])
    short = ("nothing", "half torque", "2 kg", "disturbance")
    head = ["rate [Hz]", "D", "H [ms]", *(f"{sensor}: {change}" for sensor in SENSORS for change in short), "diverge"]
    write_table("sampled-data.md", "defaults", table(head, rows))
