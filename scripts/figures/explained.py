"""The table of docs/explain.md: random failures with a known cause, and the cause that `explain` names first."""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from slidax.analysis import explain
from slidax.core.errors import DefinitionError
from slidax.scenarios import Scenario, load

from .shared import table, write_table

Changes = dict[str, Any]
Draw = Callable[[np.random.Generator, str], Changes]

ARMS = ("panda-payload", "ur5e-payload")
TABLE = ("panda-table",)
LAW = "scheme.sampled_data"
UNLEARNT: Changes = {f"{LAW}.adaptation": None}
"""A law that learns the inertia holds with a wrong model."""


def between(random: np.random.Generator, low: float, high: float) -> float:
    """A number from a log-uniform distribution, to three digits."""
    return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.3g}")


def of_arm(panda: tuple[float, float], ur5e: tuple[float, float], path: str, fixed: Changes | None = None) -> Draw:
    """Draw the value at `path` from the range of the arm; `fixed` changes come with it."""

    def draw(random: np.random.Generator, base: str) -> Changes:
        return {**(fixed or {}), path: between(random, *(panda if base.startswith("panda") else ur5e))}

    return draw


def weak_drive(random: np.random.Generator, base: str) -> Changes:
    """Give one joint 50 to 90 % of the torque that the motion needs."""
    scenario = load(base)
    run = scenario.simulate(log_every=1)
    assert run.log is not None
    tau = np.abs(np.asarray(run.log.tau))
    needed, limits = tau[len(tau) // 4 :].max(axis=0), np.asarray(scenario.controller.limits.torque)
    joint = random.integers(len(limits))
    weak = [float(f"{limit:.4g}") for limit in limits]
    weak[joint] = float(f"{random.uniform(0.5, 0.9) * needed[joint]:.3g}")
    return {"actuator.torque": weak}


def slow_rate(random: np.random.Generator, base: str) -> Changes:
    """Sample the printed step 12 to 24 times slower than the built-in scenario of the Panda."""
    steps = int(random.integers(12, 25))
    return {"simulation.period": 1e-3 * steps, "simulation.substeps": 4 * steps, f"{LAW}.horizon": None}


def coarse_steps(random: np.random.Generator, base: str) -> Changes:
    """One integration step per period, in an envelope that finer steps keep."""
    return {
        "robot.plant.coulomb": between(random, 0.3, 1.0),
        "simulation.period": 8e-3,
        "simulation.substeps": 1,
        f"{LAW}.horizon": None,
        "scheme.performance.final": 0.02,
    }


def slow_estimator(random: np.random.Generator, base: str) -> Changes:
    """A Kalman filter with too small a density of the disturbance's rate."""
    return {f"{LAW}.estimator": {"kind": "kalman", "torque_density": between(random, 1e-9, 5e-8)}}


def late(random: np.random.Generator, base: str) -> Changes:
    """Measurements that are two to five periods later than the law assumes."""
    return {"sensor.delay": int(random.integers(3, 7)), f"{LAW}.delay": 1}


FAULTS: dict[str, tuple[str, tuple[str, ...], Draw]] = {
    "model too light": (
        "inertia",
        ARMS,
        of_arm((0.07, 0.3), (0.07, 0.3), "robot.plant.armature", UNLEARNT | {"robot.nominal.armature": 0.01}),
    ),
    "model too heavy": ("inertia", ARMS, of_arm((0.005, 0.03), (0.005, 0.03), "robot.plant.armature", UNLEARNT)),
    "torque limit": ("torque", ARMS, weak_drive),
    "torque rate limit": ("torque_rate", ARMS, of_arm((40.0, 120.0), (60.0, 300.0), "actuator.rate")),
    "robust torque too small": ("robust_torque", ARMS, of_arm((0.3, 3.0), (0.5, 8.0), "scheme.bound.margin")),
    "period too long": ("period", ARMS, slow_rate),
    "integration steps too long": ("substeps", ARMS, coarse_steps),
    "payload too heavy": ("payload", ARMS, of_arm((6.0, 10.0), (8.0, 14.0), "robot.plant.load.mass")),
    "estimator too slow": ("estimator", ARMS, slow_estimator),
    "delay longer than assumed": ("delay", ARMS, late),
    "encoders too coarse": ("encoder", ARMS, of_arm((5e-4, 3e-3), (1e-3, 5e-3), "sensor.resolution")),
    "contact": ("contact", TABLE, of_arm((0.534, 0.545), (0, 0), "surroundings.table.height")),
}
"""By fault: its cause's name, the scenarios that it is put into, and its values."""


def failing(fault: str, random: np.random.Generator) -> Scenario:
    """A scenario that fails with the fault, and holds without; values with which it holds are drawn again."""
    _, bases, draw = FAULTS[fault]
    while True:
        base = bases[random.integers(len(bases))]
        usual = {
            "robot.plant.mass_factor": round(float(random.uniform(0.85, 1.1)), 2),
            "robot.plant.coulomb": round(float(random.uniform(0.1, 0.4)), 2),
        }
        if base in ARMS:
            usual["robot.plant.load.mass"] = round(float(random.uniform(0.5, 2.5)), 2)
        scenario = load(base, {**usual, **draw(random, base)})
        # A scenario that cannot start is refused: no run fails.
        with suppress(DefinitionError):
            if holds(load(base, usual)) and not holds(scenario):
                return scenario


def holds(scenario: Scenario) -> bool:
    """True if a run stays inside its envelope."""
    return scenario.simulate(log_every=None).outcome.ok


def measure_explanations() -> None:
    """Put faults into scenarios at random, and count how often `explain` names the fault first."""
    parser = argparse.ArgumentParser(description=measure_explanations.__doc__)
    parser.add_argument("--cases", type=int, default=5, help="failures for each of the 12 faults")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", choices=list(FAULTS), default=list(FAULTS))
    parser.add_argument("--write", action="store_true", help="write the table into docs/explain.md")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    rows, total = [], Counter[str]()
    for fault in options.only:
        count = Counter(failures=options.cases)
        for case in range(options.cases):
            random = np.random.default_rng([options.seed, list(FAULTS).index(fault), case])
            scenario = failing(fault, random)
            answers = explain(scenario, scenario.simulate(log_every=1))
            first = answers[0] if answers else None
            named = first is not None and first.finding.name == FAULTS[fault][0]
            remedied = first is not None and first.holds
            count.update(named=named, holds=remedied)
            if not (named and remedied):
                print(f"{fault} {case}: {[(a.finding.name, round(a.finding.weight, 2), a.holds) for a in answers]}")
                print(f"  {first.sentence() if first else 'no cause'}", flush=True)
        rows.append([fault, *(str(count[key]) for key in ("failures", "named", "holds"))])
        print(*rows[-1], sep=", ", flush=True)
        total += count
    rows.append(["all", *(str(total[key]) for key in ("failures", "named", "holds"))])
    text = table(["fault", "failures", "named first", "its remedy holds"], rows)
    print(text)
    if options.write:
        write_table("explain.md", "seeded", text)
