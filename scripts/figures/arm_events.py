"""Events in random variants, with learning of the whole arm and of each joint alone, for docs/arm-learning.md."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import bootstrap

from slidax.core.types import State
from slidax.plant.disturbances import AbstractDisturbance
from slidax.plant.sensors import AbstractSensor, Measurement
from slidax.scenarios import load

from .arm_learning import LAWS, NEVER, RATED, random_arm
from .closed_loop import CompiledLoop
from .shared import table

JOINTS = RATED.size
EARLIEST, LATEST, END = 3.0, 4.5, 6.5
"""s: when events happen, and when runs end."""

FULL = 200
"""Variants of each event, and arms of each scenario, by default."""

ARMS_END, FINE, TAIL = 8.0, 10, 0.5
"""s: when runs without events end; the plant's steps in a period there; and the time at the end of runs with events."""

OUTLIERS, WINDOW = 1.0, 0.01
"""s: time with outliers; and time before the event from which its peak is taken."""

SHARES, SHORT, LONG = (0.03, 0.06, 0.3, 0.6), (0.01, 0.1), (0.1, 1.0)
"""Pushes over rated torque, and their durations, s."""


class Event(AbstractDisturbance):
    """A push, a change of friction, and a stop, with their values."""

    values: dict[str, jax.Array]

    def __call__(self, t: Any, state: Any) -> Any:
        v, q, dq = self.values, state.q, state.dq
        after = t >= v["at"]
        push = jnp.where(after & (t < v["until"]), v["push"], 0.0)
        friction = jnp.where(after, -v["friction"] * jnp.tanh(dq / 0.01), 0.0)
        depth, speed = v["side"] * (q - v["stop"]), v["side"] * dq
        stop = jnp.where(after, -3000.0 * jnp.maximum(depth, 0.0) * jnp.maximum(0.0, 1.0 + 0.5 * speed), 0.0)
        return push + friction + v["side"] * stop


class Outliers(AbstractSensor):
    """Measurement of a sensor, with a wrong position of one joint at every `spacing`-th sample for a second."""

    sensor: AbstractSensor
    values: dict[str, jax.Array]

    def init(self, state: State) -> Any:
        return self.sensor.init(state)

    def __call__(self, k: Any, state: State, period: Any, memory: Any) -> tuple[Measurement, Any]:
        measured, memory = self.sensor(k, state, period, memory)
        v, since = self.values, k * period - self.values["at"]
        place = jnp.floor(since / period + 0.5)
        number = jnp.floor(place / v["spacing"])
        hit = (since >= 0.0) & (since < OUTLIERS) & (place - number * v["spacing"] < 0.5)
        sign = 1.0 - 2.0 * (number - 2.0 * jnp.floor(0.5 * number))
        q = measured.state.q + jnp.where(hit, sign, 0.0) * v["outlier"]
        return Measurement(State(q=q, dq=measured.state.dq), measured.fresh), memory


def drawn(variants: int, seed: int) -> dict[str, dict[str, np.ndarray]]:
    """Values of each event in random variants, each with another arm, motion and time."""
    cases = {}
    names = ["payload released", "payload grasped"]
    for share in SHARES:
        for least, most in (SHORT, LONG):
            names.append(f"push of {100 * share:g} % for {least:g} to {most:g} s")
    names += ["contact with a stop", "friction that changes", "encoder outliers"]
    trajectory = load("panda-payload").trajectory
    amplitude, frequency = np.asarray(trajectory.amplitude), np.asarray(trajectory.frequency)
    for number, name in enumerate(names):
        rng = np.random.default_rng([seed, number])
        size = variants, JOINTS
        v = random_arms(rng, variants, JOINTS, 3.0) | {
            "shift": rng.uniform(-0.3, 0.3, size),
            "phase": rng.uniform(0.0, 2.0 * np.pi, size),
            "at": np.round(rng.uniform(EARLIEST, LATEST, variants), 3),
            "until": np.full(variants, NEVER),
            "push": np.zeros(size),
            "friction": np.zeros(size),
            "stop": np.full(size, NEVER),
            "side": np.ones(size),
            "outlier": np.zeros(size),
            "spacing": np.full(variants, 10.0),
            "released": np.full(variants, NEVER),
            "attached": np.zeros(variants),
        }
        # Half of the variants concern one joint, the others all joints.
        joint = np.arange(JOINTS) == rng.integers(0, JOINTS, (variants, 1))
        acts, sign = joint | (rng.random((variants, 1)) < 0.5), rng.choice([-1.0, 1.0], size)
        if name == "payload released":
            v["released"] = v["at"]
        elif name == "payload grasped":
            v["attached"] = v["at"]
        elif name.startswith("push"):
            share, (least, most) = SHARES[(number - 2) // 2], (SHORT, LONG)[number % 2]
            duration = np.exp(rng.uniform(np.log(least), np.log(most), variants))
            v["push"], v["until"] = share * RATED * acts * sign, v["at"] + duration
        elif name == "contact with a stop":
            # The joint is on the other half of its motion when the stop appears.
            wave = np.sin(frequency * v["at"][:, None] + v["phase"])
            v["side"] = np.where(wave > 0.0, -1.0, 1.0)
            at = np.asarray(trajectory.offset) + v["shift"]
            at = at + v["side"] * amplitude * rng.uniform(0.3, 0.9, (variants, 1))
            v["stop"] = np.where(joint, at, v["side"] * NEVER)
        elif name == "friction that changes":
            v["friction"] = acts * rng.uniform(-v["coulomb"], 1.0)
        else:
            v["outlier"] = acts * sign * np.exp(rng.uniform(np.log(1e-4), 0.0, (variants, 1)))
            v["spacing"] = np.round(np.exp(rng.uniform(np.log(3.0), np.log(100.0), variants)))
        cases[name] = v
    return cases


def random_arms(rng: np.random.Generator, arms: int, joints: int, payload: float) -> dict[str, np.ndarray]:
    """Values of random arms: link masses, payload, rotors and friction."""
    size = arms, joints
    return {
        "mass": rng.uniform(0.8, 1.2, (arms, 1)),
        "payload": rng.uniform(0.05, payload, arms),
        "rotor": np.exp(rng.uniform(np.log(0.03), np.log(0.25), size)),
        "coulomb": rng.uniform(0.1, 0.6, size),
        "viscous": rng.uniform(0.05, 0.4, size),
    }


def definition(changes: dict[str, Any], name: str = "panda-payload", substeps: int = 5) -> tuple[Any, Any]:
    """The scenario, and the map from the values of a run to its parts; without events if the values have none."""
    scenario = load(name, {"simulation.substeps": substeps, **changes})
    plant, law, motion, state, *_ = scenario.parts

    def define(v: dict[str, Any]) -> Any:
        changed = random_arm(plant, law.nominal, v)
        if "at" not in v:
            return changed, law, motion, state
        changed = eqx.tree_at(
            lambda p: (p.load.released, p.load.attached, p.disturbance, p.sensor),
            changed,
            (
                v["released"],
                v["attached"],
                Event({key: v[key] for key in ("at", "until", "push", "friction", "stop", "side")}),
                Outliers(plant.sensor, {key: v[key] for key in ("at", "outlier", "spacing")}),
            ),
        )
        moved = eqx.tree_at(lambda m: (m.offset, m.phase), motion, (motion.offset + v["shift"], v["phase"]))
        start = State(q=state.q + v["shift"] + motion.amplitude * jnp.sin(v["phase"]), dq=state.dq)
        return changed, law, moved, start

    return scenario, define


def summary(values: np.ndarray) -> tuple[float, float, float]:
    """Median, 90 % and largest."""
    return float(np.median(values)), float(np.quantile(values, 0.9)), float(values.max())


def ratio_interval(errors: np.ndarray, reference: np.ndarray, share: float) -> str:
    """Ratio of a quantile of errors to that of reference errors in the same variants, with its 95 % interval."""

    def ratio(first: np.ndarray, second: np.ndarray, axis: int = -1) -> Any:
        return np.quantile(first, share, axis=axis) / np.quantile(second, share, axis=axis)

    draws = bootstrap((errors, reference), ratio, paired=True, method="percentile", rng=np.random.default_rng(0))
    low, high = draws.confidence_interval
    return f"{ratio(errors, reference):.2f} [{low:.2f}, {high:.2f}]"


def measure_events() -> None:
    """Peak errors and samples outside for random events: median, 90 % and worst, with both learnings."""
    parser = argparse.ArgumentParser(description=measure_events.__doc__)
    parser.add_argument("--variants", type=int, default=FULL, help="of each event")
    parser.add_argument("--events", nargs="*", default=[], help="only events whose name contains one of these")
    parser.add_argument("--seed", type=int, default=1, help="of the random variants")
    parser.add_argument("--workers", type=int, help="processes; by default one for each processor")
    arguments = parser.parse_args()
    cases = drawn(arguments.variants, arguments.seed)
    rows = []
    with TemporaryDirectory() as folder:
        laws = {}
        for number, (name, changes) in enumerate(LAWS.items()):
            place = Path(folder, str(number))
            place.mkdir()
            laws[name] = CompiledLoop(*definition(changes), example_of(next(iter(cases.values()))), END, place)
        for event, values in cases.items():
            if arguments.events and not any(part in event for part in arguments.events):
                continue
            started = time.perf_counter()
            since = values["at"] - WINDOW
            results = {name: law.measured(values, since, TAIL, arguments.workers) for name, law in laws.items()}
            rows.append(row_of(event, results))
            print(" | ".join(rows[-1]), f"({time.perf_counter() - started:.0f} s)", flush=True)
    print(table(HEAD, rows))


def measure_arms() -> None:
    """Errors of random arms without events, with both learnings."""
    parser = argparse.ArgumentParser(description=measure_arms.__doc__)
    parser.add_argument("scenarios", nargs="*", default=["panda-payload", "ur5e-payload"], help="scenarios")
    parser.add_argument("--arms", type=int, default=FULL, help="of each scenario")
    parser.add_argument("--seed", type=int, default=1, help="of the random arms")
    parser.add_argument("--payload", type=float, default=3.0, help="largest payload [kg]")
    parser.add_argument("--workers", type=int, help="processes; by default one for each processor")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.scenarios:
        rng = np.random.default_rng(arguments.seed)
        values = random_arms(rng, arguments.arms, load(name).plant.robot.joints, arguments.payload)
        for law, changes in LAWS.items():
            with TemporaryDirectory() as folder:
                scenario, define = definition(changes, name, FINE)
                loop = CompiledLoop(scenario, define, example_of(values), ARMS_END, Path(folder))
                runs = loop.measured(values, np.zeros(arguments.arms), 0.5 * ARMS_END, arguments.workers)
            inside = f"{np.sum(runs['outside'] == 0)} of {arguments.arms}"
            rows.append([name, law, inside, *(f"{value:.2e}" for value in summary(runs["steady"]))])
            print(" | ".join(rows[-1]), flush=True)
    print(table(["scenario", "learning", "inside", "error of the last 4 s: median [rad]", "90 %", "largest"], rows))


def example_of(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values of the first run."""
    return {name: value[0] for name, value in values.items()}


HEAD = [
    "event",
    *(f"{what}, {law}" for what in ("peak [rad]", "samples outside") for law in LAWS),
    "outside at the end",
    "ratio of peaks, median",
    "ratio of peaks, 90 %",
]


def row_of(event: str, results: dict[str, dict[str, np.ndarray]]) -> list[str]:
    """An event's line of the table."""
    peaks = [" / ".join(f"{value:.1e}" for value in summary(runs["peak"])) for runs in results.values()]
    outside = [" / ".join(f"{math.ceil(value)}" for value in summary(runs["outside"])) for runs in results.values()]
    lost = " / ".join(f"{np.sum(runs['lost']):.0f}" for runs in results.values())
    reference, learnt = (runs["peak"] for runs in results.values())
    ratios = [ratio_interval(learnt, reference, share) for share in (0.5, 0.9)]
    return [event, *peaks, *outside, lost, *ratios]
