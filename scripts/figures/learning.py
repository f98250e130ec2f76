"""Figures and tables of docs/learning.md and docs/identification.md."""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import slidax as sx
from slidax import analysis, scenarios
from slidax.arms import Payload
from slidax.identify import Identification, JointLog, excite, identify, write_arm
from slidax.law.joint_loop import LinearLoop
from slidax.law.kalman import steady_gains
from slidax.report.figures.style import LINES, NARROW, WIDTH, styled
from slidax.simulation import Run

from .shared import plain_numbers, save, small, steady_error, steady_step, table, write_table

ARMS = ("panda-payload", "ur5e-payload")
NOMINAL = (0.0, 0.03, 0.1, 0.2)
TRUE = (0.02, 0.05, 0.1, 0.3)
CORNERS = ((0.1, 0.1), (0.0, 0.1), (0.1, 0.03), (0.03, 0.3))
"""Nominal and true rotors [kg m²] that the harder cases are tried with."""

OFF = {"scheme.sampled_data.adaptation": None}


def run(name: str, nominal: float, true: float, changes: dict[str, Any] | None = None) -> Run:
    """A built-in scenario with the same rotor inertia on all joints.

    - `nominal`, `true`: rotor inertia that the law believes in, and that the arm has [kg m²].
    """
    rotors = {"robot.nominal.armature": nominal, "robot.plant.armature": true}
    return scenarios.load(name, {**rotors, **(changes or {})}).simulate(log_every=None, progress=False)


def outside(of: Run) -> int:
    """Samples outside the envelope."""
    count = analysis.envelope_violations(of)
    assert isinstance(count, int)
    return count


def worst(runs: list[Run]) -> tuple[int, float, float]:
    """Samples outside of all runs together, the largest steady error [rad] and the largest steady torque step [N m]."""
    return (
        sum(outside(finished) for finished in runs if finished.has_envelope),
        float(np.max([steady_error(finished) for finished in runs])),
        float(np.max([steady_step(finished) for finished in runs])),
    )


HARDER: list[tuple[str, str, dict[str, Any]]] = [
    *((name, f"delay of {delay} periods", {"sensor.delay": delay}) for name in ARMS for delay in (2, 3)),
    *((name, f"encoders of {step:g} rad", {"sensor.resolution": step}) for name in ARMS for step in (1e-4, 2.5e-4)),
    *((name, f"payload of {mass:g} kg", {"robot.plant.load.mass": mass}) for name in ARMS for mass in (1.0, 4.0)),
    *((name, "no payload", {"robot.plant.load": None}) for name in ARMS),
    *((name, "as it is", {}) for name in ("panda-table", "panda-pick", "panda-drop")),
]
BEYOND = (0.005, 0.5, 1.0)


def write_wrong_rotors() -> None:
    """Simulate wrong rotors with learning, without it, and in harder cases; write the tables of docs/learning.md."""
    _cells()
    rows = []
    for name in ARMS:
        for true in BEYOND:
            runs = [run(name, nominal, true) for nominal in NOMINAL]
            rows.append([name, f"true rotors of {true:g}, the four nominal ones", *_row(runs)])
    for name, what, changes in HARDER:
        rows.append([name, what, *_row([run(name, *corner, changes) for corner in CORNERS])])
    head = ["scenario", "case", "samples outside", "largest steady error [rad]", "largest step [N m]"]
    write_table("learning.md", "harder", table(head, rows))


def _row(runs: list[Any]) -> list[str]:
    count, error, step = worst(runs)
    return [f"{count}", small(error), f"{step:.2g}"]


def _cells() -> None:
    rows = []
    for name in ARMS:
        for true in TRUE:
            known = run(name, true, true, OFF)
            for nominal in NOMINAL:
                without, learns = run(name, nominal, true, OFF), run(name, nominal, true)
                rows.append(
                    [
                        name.removesuffix("-payload"),
                        f"{nominal:g}",
                        f"{true:g}",
                        f"{outside(without)}",
                        f"{outside(learns)}",
                        small(steady_error(known)),
                        small(steady_error(learns)),
                        f"{steady_step(learns):.2f}",
                    ]
                )
    head = [
        "arm",
        "nominal",
        "true [kg m²]",
        "outside, nothing learnt",
        "outside, learning",
        "error of the known arm [rad]",
        "error, learning [rad]",
        "step, learning [N m]",
    ]
    write_table("learning.md", "cells", table(head, rows))


HORIZONS = np.array([3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0])
DELAYS = (0, 1, 2, 3)
PACES = (0.7, 1.4, 2.8)
"""ω H of the estimator."""

CHECKED = (5.0, 10.0, 20.0)
VARIANCE = 1e-12
HEAVY = 50.0
"""kg m² of each rotor in the simulated arm; its links hardly count."""


def joint_loop(horizon: float, delay: float, pace: float) -> LinearLoop:
    """The loop of a joint with a Kalman filter.

    - `horizon`: H [periods].
    - `delay`: D [periods].
    """
    ratio = (pace / horizon) ** 6
    first, second, third = (float(gain) for gain in steady_gains(ratio, 1.0, 1.0))
    return LinearLoop(1.0, horizon, float(delay), (first, second, third), measures_velocity=False)


def simulated_range(horizon: float, delay: int, pace: float) -> tuple[float, float]:
    """The κ for which a simulated joint comes to rest."""
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
def draw_region() -> Figure:
    """The picture: the bounds of κ over the horizon, for each delay, and for each pace of the estimator."""
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    by_delay, by_pace = figure.subplots(1, 2, sharey=True)
    for look, delay in zip(LINES, DELAYS, strict=False):
        _draw_range(by_delay, [joint_loop(h, delay, 1.4) for h in HORIZONS], look, f"D = {delay}")
    for look, pace in zip(LINES, PACES, strict=False):
        _draw_range(by_pace, [joint_loop(h, 1, pace) for h in HORIZONS], look, f"ωH = {pace:g}")
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
    ranges = np.array([linear.stable_range() for linear in loops])
    axes.plot(HORIZONS, ranges[:, 0], **look, label=label)
    axes.plot(HORIZONS, ranges[:, 1], **look)


def write_inertia_region() -> None:
    """Write the picture, and the table that compares it with simulations."""
    save(draw_region(), "inertia-region")
    rows = []
    for delay in (0, 1, 3):
        for horizon in CHECKED:
            linear = joint_loop(horizon, delay, 1.4).stable_range()
            simulated = simulated_range(horizon, delay, 1.4)
            rows.append([f"{delay}", f"{horizon:g}", *(f"{x:.2g}" for x in (*linear, *simulated))])
    head = ["D", "H/h", "κ from", "to", "simulated, from", "to"]
    write_table("learning.md", "region", table(head, rows))


SCHEMES = ("cftsmppc", "slotine_li_ppc", "slotine_li", "super_twisting", "computed_torque", "gravity_pd")


def write_rivals_that_learn() -> None:
    """Simulate each law in all 16 pairs of nominal and true rotors, and write the table of docs/learning.md."""
    rows = []
    for name in ARMS:
        final = scenarios.load(name).controller.step.transformation.performance.final
        for scheme in SCHEMES:
            changes = {} if scheme == "cftsmppc" else {"scheme.name": scheme}
            runs = [run(name, nominal, true, changes) for true in TRUE for nominal in NOMINAL]
            errors = [steady_error(finished) for finished in runs]
            rows.append(
                [
                    name.removesuffix("-payload"),
                    f"`{scheme}`",
                    f"{sum(error < 0.3 * float(final) for error in errors)} of {len(errors)}",
                    small(float(np.min(errors))),
                    small(float(np.median(errors))),
                    small(float(np.max(errors))),
                    f"{max(steady_step(finished) for finished in runs):.2g}",
                ]
            )
    head = ["arm", "scheme", "steady within 0.3 ρ∞", "least error [rad]", "median", "largest", "largest step [N m]"]
    write_table("learning.md", "rivals", table(head, rows))


RESOLUTION, TORQUE_NOISE = 1e-5, 0.01
"""Of the encoders [rad]; of the torques, as a share of each joint's root mean square."""

STIFF, SOFT = [*4 * (400.0,), *3 * (60.0,)], [*4 * (20.0,), *3 * (3.0,)]
PD = {"scheme.name": "gravity_pd", "scheme.kp": STIFF, "scheme.kd": SOFT}
"""The law that moves an arm whose inertia nobody knows."""

NAMES = (
    *("armature", "coulomb", "viscous", "offset", "payload.mass"),
    *(f"payload.center.{axis}" for axis in "xyz"),
    *(f"payload.inertia.{pair}" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")),
)


def rounded(values: np.ndarray) -> list[float]:
    """Values as in a scenario file."""
    return [round(float(value), 5) for value in values]


def unknown_arm(number: int) -> dict[str, Any]:
    """Properties of an arm that its law does not know.

    - `number`: of the arm; the same number gives the same arm.
    """
    rng = np.random.default_rng(1000 + number)
    mass, sides = rng.uniform(0.5, 3.0), rng.uniform(0.03, 0.1, 3)
    return {
        "armature": rounded(np.exp(rng.uniform(np.log(0.05), np.log(0.3), 7))),
        "coulomb": rounded(rng.uniform(0.2, 0.8, 7)),
        "viscous": rounded(rng.uniform(0.1, 0.5, 7)),
        "load": {
            "mass": round(mass, 5),
            "center": rounded(np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.03, 0.15)])),
            "inertia": rounded(mass / 3.0 * (sides @ sides - sides**2)),
        },
    }


def truth(arm: dict[str, Any]) -> np.ndarray:
    """An arm's parameters in the order of NAMES."""
    load = arm["load"]
    drives = [*arm["armature"], *arm["coulomb"], *arm["viscous"], *7 * (0.0,)]
    return np.array([*drives, load["mass"], *load["center"], *load["inertia"], *3 * (0.0,)])


def simulated(arm: dict[str, Any], motion: Path) -> JointLog:
    """Positions and torques of the arm in MuJoCo with dry friction, moved by a PD law that knows its links alone."""
    start = [float(cell) for cell in motion.read_text().splitlines()[1].split(",")[1:8]]
    run = scenarios.load(
        "panda-payload",
        {
            # A guess of the rotors, for the estimator of velocities.
            "robot.nominal": {"armature": 0.1},
            "robot.plant": arm,
            "trajectory": {"kind": "csv", "file": str(motion)},
            "start.q": start,
            "simulation.plant": "mujoco",
            "simulation.friction": "dry",
            "simulation.t1": 20.0,
            **PD,
        },
    ).simulate(log_every=1, progress=False)
    assert run.outcome.ok, run.outcome.message
    names = sx.arms.panda().joint_names
    return JointLog("a run", names, np.asarray(run.log.t), np.asarray(run.log.state.q), np.asarray(run.log.tau))


def measured(log: JointLog, seed: int) -> JointLog:
    """The log of encoders and of torque sensors with noise."""
    size = TORQUE_NOISE * np.sqrt(np.mean(log.tau**2, axis=0))
    tau = log.tau + size * np.random.default_rng(seed).normal(size=log.tau.shape)
    return JointLog(log.source, log.joints, log.t, RESOLUTION * np.round(log.q / RESOLUTION), tau)


def errors(estimate: Identification, arm: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of all parameters, and errors over their standard errors."""
    off = np.concatenate([estimate.values(name) for name in NAMES]) - truth(arm)
    return off, off / np.concatenate([estimate.standard_errors(name) for name in NAMES])


def measure_errors(arms: int, noises: int, motion: Path) -> None:
    """Print the largest errors over many logs, and how often the truth is inside of the 95 % interval."""
    rows, inside, took = [], [], []
    for number in range(arms):
        arm = unknown_arm(number)
        log, true = simulated(arm, motion), truth(arm)
        for seed in range(noises):
            estimate = identify(measured(log, seed), sx.arms.panda())
            took.append(estimate.seconds)
            off, in_errors = errors(estimate, arm)
            drives = [100 * np.abs(off[i : i + 7] / true[i : i + 7]).max() for i in (0, 7)]
            rows.append([*drives, 100 * abs(off[28] / true[28]), 1e3 * np.abs(off[29:32]).max()])
            inside.append(np.abs(in_errors) < 1.96)
        print(f"arm {number + 1}: {np.max(rows, axis=0).round(3)}, {np.mean(inside):.3f}", file=sys.stderr, flush=True)
    print("| | rotors [%] | Coulomb [%] | payload mass [%] | centre [mm] |\n|---|---:|---:|---:|---:|")
    for name, values in (("largest error", np.max(rows, axis=0)), ("median over the logs", np.median(rows, axis=0))):
        print(f"| {name} |" + "".join(f" {value:.2g} |" for value in values))
    share = 100 * np.mean(inside, axis=0)
    print(
        f"inside of the 95 % interval: {share.mean():.1f} % of {len(inside)} logs and {len(share)} numbers; by number"
    )
    print(f"{share.min():.0f} to {share.max():.0f} %; {np.median(took):.1f} s a log")


def close_loop(motion: Path, folder: Path) -> None:
    """Print the error of laws that know the arm, that know what was identified, and that know its links alone."""
    arm = unknown_arm(0)
    estimate = identify(measured(simulated(arm, motion), 0), sx.arms.panda())
    write_arm(estimate, {"kind": "panda"}, folder / "arm.yaml")
    unknown = scenarios.load("panda-payload", {"robot.nominal": {}, "robot.plant": arm})
    known = {"robot.nominal": {"armature": arm["armature"], "load": arm["load"]}}
    laws = {
        "known": known,
        "identified": {"robot.kind": "identified", "robot.file": str(folder / "arm.yaml")},
        "links alone": {"robot.nominal": {}},
    }
    print("| law knows | samples outside | steady error [rad] |\n|---|---:|---:|")
    for name, changes in laws.items():
        law = scenarios.load("panda-payload", {"robot.plant": {}, **changes}).controller
        run = unknown.replace(controller=law).simulate(log_every=None, progress=False)
        print(f"| {name} | {analysis.envelope_violations(run)} | {np.max(analysis.steady_error(run)):.2e} |")


def measure_identification() -> None:
    """Measure errors and intervals on many logs, and the loop closed over one of them, for docs/identification.md."""
    parser = argparse.ArgumentParser(description=measure_identification.__doc__)
    parser.add_argument("--arms", type=int, default=10, help="how many")
    parser.add_argument("--noises", type=int, default=10, help="logs of each, with different noise")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        motion = Path(folder) / "motion.csv"
        excite(sx.arms.panda(), seed=1, payload=Payload(mass=3.0)).write(motion)
        close_loop(motion, Path(folder))
        measure_errors(arguments.arms, arguments.noises, motion)
