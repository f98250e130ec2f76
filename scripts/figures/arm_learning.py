"""Tables of docs/arm-learning.md: events and random arms, with learning of the whole arm and calm steps, or without."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.types import State
from slidax.plant.disturbances import AbstractDisturbance
from slidax.scenarios import load
from slidax.simulation import simulate_batch

from .shared import table, write_table

PAGE = "arm-learning.md"
LAWS: dict[str, dict[str, Any]] = {
    "`joint_learning`": {},
    "`arm_learning`": {"scheme.sampled_data.adaptation": {"kind": "arm_learning"}},
}
ARM = LAWS["`arm_learning`"]
CALM = "`arm_learning`, calm"
FRONT: dict[str, dict[str, Any]] = {
    "`cftsmppc`, `joint_learning`": {},
    "`cftsmppc`, `joint_learning`, calm": {"scheme.sampled_data.calm": True},
    "`computed_torque`": {**ARM, "scheme.name": "computed_torque"},
    "`slotine_li`": {**ARM, "scheme.name": "slotine_li"},
    "`super_twisting`": {**ARM, "scheme.name": "super_twisting"},
    "`cftsmppc`": ARM,
    "`cftsmppc`, horizon 14 ms": {**ARM, "scheme.sampled_data.horizon": 0.014},
    "`cftsmppc`, horizon 20 ms": {**ARM, "scheme.sampled_data.horizon": 0.020},
    "`cftsmppc`, calm, 120 rad/s": {**ARM, "scheme.sampled_data.calm": {"bandwidth": 120.0, "fastest": 210.0}},
    "`cftsmppc`, calm": {**ARM, "scheme.sampled_data.calm": True},
    "`cftsmppc`, calm, 30 rad/s": {**ARM, "scheme.sampled_data.calm": {"bandwidth": 30.0}},
}
"""Laws on `panda-payload`: all but the first two with `arm_learning`."""
RATED = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
NEVER = 1e9
EVENT, END, STEADY = 5.0, 8.0, 1.0
"""s: when events happen, when runs end, and the time before the end over which the steady error is taken."""

ARMS, SEED = 20, 11


class Event(AbstractDisturbance):
    """A push, more friction, a stop, Stribeck friction and cogging, with their values."""

    values: dict[str, jax.Array]

    def __call__(self, t: Any, state: Any) -> Any:
        v, q, dq = self.values, state.q, state.dq
        push = jnp.where((t >= EVENT) & (t < v["until"]), v["push"], 0.0)
        friction = jnp.where(t >= EVENT, -v["friction"] * jnp.tanh(dq / 0.01), 0.0)
        stop = -3000.0 * jnp.maximum(0.0, q - v["stop"]) * jnp.maximum(0.0, 1.0 + 0.5 * dq)
        stribeck = -v["stribeck"] * jnp.tanh(dq / 0.006) * jnp.exp(-((dq / 0.05) ** 2))
        return push + friction + stop + stribeck + v["cogging"] * jnp.sin(30.0 * q)


def events() -> dict[str, dict[str, np.ndarray]]:
    """Values of each event."""
    none = np.zeros(7)
    calm = {
        "until": NEVER,
        "push": none,
        "friction": none,
        "stop": np.full(7, NEVER),
        "stribeck": none,
        "cogging": none,
        "released": NEVER,
        "attached": 0.0,
    }
    cases: dict[str, dict[str, Any]] = {
        "nothing": {},
        "payload released": {"released": EVENT},
        "payload grasped": {"attached": EVENT},
    }
    rng = np.random.default_rng(5)
    for share in (0.03, 0.06, 0.3):
        for duration in (0.01, 0.1, 1.0):
            push = share * RATED * rng.choice([-1.0, 1.0], 7)
            name = f"push of {100 * share:g} % of rated torque for {duration:g} s"
            cases[name] = {"push": push, "until": EVENT + duration}
    cases |= {
        "stop at joint 1": {"stop": np.where(np.arange(7) == 0, 0.3, NEVER)},
        "stop at joint 4": {"stop": np.where(np.arange(7) == 3, -2.1, NEVER)},
        "friction doubles": {"friction": np.full(7, 0.3)},
        "friction grows by 1 N m": {"friction": np.full(7, 1.0)},
        "friction vanishes": {"friction": np.full(7, -0.3)},
        "Stribeck friction of 0.1 N m": {"stribeck": np.full(7, 0.1)},
        "cogging of 0.05 N m": {"cogging": np.full(7, 0.05)},
        "cogging of 0.2 N m": {"cogging": np.full(7, 0.2)},
    }
    return {
        name: {key: np.asarray(value, float) for key, value in {**calm, **case}.items()} for name, case in cases.items()
    }


def write_events() -> None:
    """Simulate `panda-payload` with events at 5 s, and write the table."""
    cases = events()
    stacked = jax.tree.map(lambda *values: jnp.stack([jnp.asarray(v) for v in values]), *cases.values())
    columns = {}
    for law_name, changes in {**LAWS, CALM: {**ARM, "scheme.sampled_data.calm": True}}.items():
        scenario = load("panda-payload", {"simulation.substeps": 5, **changes})
        plant, law, motion, state, *_ = scenario.parts

        def define(values: Any, plant: Any = plant, law: Any = law, motion: Any = motion, state: Any = state) -> Any:
            own = {key: value for key, value in values.items() if key not in ("released", "attached")}
            changed = eqx.tree_at(
                lambda p: (p.disturbance, p.load.released, p.load.attached),
                plant,
                (Event(own), values["released"], values["attached"]),
            )
            return changed, law, motion, state

        run = simulate_batch(define, stacked, t1=END, stepping=scenario.stepping, log_every=1, threads=2)
        columns[law_name] = _measured(run, scenario.period)
    words = [lambda value: f"{value:.1e}", str, lambda value: f"{value:.1e}"]
    for laws, name, count in ((list(LAWS), "events", 3), ([list(LAWS)[1], CALM], "calm-events", 2)):
        rows = [
            [event, *(words[k](columns[law][k][i]) for k in range(count) for law in laws)]
            for i, event in enumerate(cases)
        ]
        heads = ("peak [rad]", "samples outside", "error at the end [rad]")[:count]
        write_table(PAGE, name, table(["event", *(f"{what}, {law}" for what in heads for law in laws)], rows))


def random_arm(plant: Any, nominal: Any, values: Any) -> Any:
    """The plant with masses relative to those of the nominal arm, and with rotors, friction and payload."""
    return eqx.tree_at(
        lambda p: (
            p.robot.masses,
            p.robot.inertias,
            p.robot.armature,
            p.robot.coulomb,
            p.robot.viscous,
            p.load.payload.mass,
        ),
        plant,
        (
            nominal.masses * values["mass"],
            nominal.inertias * values["mass"][:, None, None],
            values["rotor"],
            values["coulomb"],
            values["viscous"],
            values["payload"],
        ),
    )


def write_random_arms() -> None:
    """Simulate `panda-payload` with random links, payloads, rotors and friction, and write the table."""
    rng = np.random.default_rng(SEED)
    values = {
        "mass": rng.uniform(0.8, 1.2, (ARMS, 1)) * np.ones((1, 7)),
        "payload": rng.uniform(0.05, 3.0, ARMS),
        "rotor": np.exp(rng.uniform(np.log(0.03), np.log(0.25), (ARMS, 7))),
        "coulomb": rng.uniform(0.1, 0.6, (ARMS, 7)),
        "viscous": rng.uniform(0.05, 0.4, (ARMS, 7)),
    }
    rows = []
    for name, changes in {**LAWS, CALM: {**ARM, "scheme.sampled_data.calm": True}}.items():
        scenario = load("panda-payload", {"simulation.substeps": 5, **changes})
        plant, law, motion, state, *_ = scenario.parts

        def define(v: Any, plant: Any = plant, law: Any = law, motion: Any = motion, state: Any = state) -> Any:
            return random_arm(plant, law.nominal, v), law, motion, state

        run = simulate_batch(
            define, jax.tree.map(jnp.asarray, values), t1=END, stepping=scenario.stepping, log_every=1, threads=2
        )
        _, outside, _ = _measured(run, scenario.period)
        half = round(0.5 * END / scenario.period)
        error = np.abs(np.asarray(run.log.e)[:, half:]).max(axis=(1, 2))
        step = np.abs(np.diff(np.asarray(run.log.tau)[:, half:], axis=1)).max(axis=(1, 2))
        rows.append(
            [
                name,
                f"{np.sum(np.array(outside) == 0)} of {ARMS}",
                f"{np.median(error):.1e}",
                f"{error.max():.1e}",
                f"{np.median(step):.2f}",
            ]
        )
    head = ["learning", "inside", "median steady error [rad]", "largest", "median largest torque step [N m]"]
    write_table(PAGE, "random-arms", table(head, rows))


def write_calm_front() -> None:
    """Simulate `panda-payload` with each law, and write the table of error against torque noise."""
    rows = []
    for name, changes in FRONT.items():
        scenario = load("panda-payload", changes)
        log = scenario.simulate().log
        late = np.asarray(log.t) > 0.5 * END
        steps = np.diff(np.asarray(log.tau)[late], axis=0)
        noise = steps - np.diff(ideal_torque(scenario, np.asarray(log.t)[late]), axis=0)
        rows.append(
            [
                name,
                f"{np.abs(np.asarray(log.e)[late]).max():.1e}",
                f"{np.abs(steps).max():.3f}",
                f"{np.sqrt(np.mean(noise**2, axis=0)).max():.4f}",
            ]
        )
    head = ["law", "steady error [rad]", "largest torque step [N m]", "torque noise [N m]"]
    write_table(PAGE, "calm-front", table(head, rows))


def ideal_torque(scenario: Any, times: np.ndarray) -> np.ndarray:
    """The torque that the true arm needs on its reference at these times [samples n], N m."""
    plant, _, motion, *_ = scenario.parts

    def needed(t: jax.Array) -> jax.Array:
        now = motion.reference(t)
        state, still = State(q=now.q, dq=now.dq), jnp.zeros_like(now.q)
        return plant.at(t).mass(now.q) @ (now.ddq - plant.acceleration(t, state, still))

    return np.asarray(jax.jit(jax.vmap(needed))(jnp.asarray(times)))


def _measured(run: Any, period: float) -> tuple[np.ndarray, list[int], np.ndarray]:
    """Peak from just before the event on, samples outside, and error at the end, of each run."""
    e = np.asarray(run.log.e)
    lower, upper = np.asarray(run.log.envelope.lower), np.asarray(run.log.envelope.upper)
    outside = ((e <= lower) | (e >= upper)).any(axis=-1).sum(axis=1)
    largest = np.abs(e).max(axis=-1)
    before, last = round((EVENT - 0.1) / period), round(STEADY / period)
    return largest[:, before:].max(axis=1), [int(count) for count in outside], largest[:, -last:].max(axis=1)


FREE = 1e-9
"""N m: LuGre friction of a joint without it."""
RIGID = {
    "transmission.friction": {"coulomb": FREE, "static": FREE, "stribeck_velocity": 0.05},
    "disturbance.terms": [
        {"kind": "stribeck", "excess": 0.0, "velocity": 0.05, "smoothing": 0.006},
        {"kind": "ripple", "amplitude": 0.0, "periods": 30.0},
    ],
}
ELASTIC = {"transmission.elasticity": {"stiffness": 1e4, "damping": 5.0, "encoder": "link"}}
STRIBECK = {"disturbance.terms.0.excess": 0.09}
COGGING = {"disturbance.terms.1.amplitude": 0.05}
LUGRE = {
    "robot.plant.coulomb": 0.0,
    "transmission.friction.coulomb": 0.3,
    "transmission.friction.static": 0.39,
}
FRICTIONS: dict[str, tuple[dict[str, Any], dict[str, float]]] = {
    "as in the model": (RIGID, {}),
    "Stribeck friction, 30 % above Coulomb": (RIGID, STRIBECK),
    "cogging of 0.05 N m": (RIGID, COGGING),
    "cogging of 0.2 N m": (RIGID, {"disturbance.terms.1.amplitude": 0.2}),
    "Stribeck friction, cogging of 0.05 N m": (RIGID, {**STRIBECK, **COGGING}),
    "LuGre friction": (RIGID, LUGRE),
    "LuGre friction, cogging of 0.05 N m": (RIGID, {**LUGRE, **COGGING}),
    "elastic joints of 10 kN m/rad": (ELASTIC, {}),
    "elastic joints of 30 kN m/rad": (ELASTIC, {"transmission.elasticity.stiffness": 3e4}),
}
"""Friction and joints of `panda-payload`'s true arm: what they have in common with others, and their own values."""

SHAPES: dict[str, dict[str, Any]] = {
    "`joint_learning`": {},
    "`arm_learning`": {"kind": "arm_learning"},
    "`arm_learning` with both": {"kind": "arm_learning", "stribeck": 0.05, "ripple": 30.0},
}
"""Adaptations of the law; the last one with `stribeck` and `ripple`."""


def write_unmodelled_friction() -> None:
    """Simulate `panda-payload` with friction and joints that its model lacks, and write the table."""
    rows: dict[str, list[str]] = {name: [name] for name in FRICTIONS}
    steps: dict[str, list[str]] = {name: [] for name in FRICTIONS}
    for label, learning in SHAPES.items():
        law = {"scheme.sampled_data.adaptation": learning} if learning else {}
        for name, (common, own) in FRICTIONS.items():
            run = load("panda-payload", deepcopy({**common, **own, **law})).simulate(log_every=1, progress=False)
            late = np.asarray(run.log.t) > 0.5 * END
            error = np.abs(np.asarray(run.log.e)[late]).max()
            step = np.abs(np.diff(np.asarray(run.log.tau)[late], axis=0)).max()
            outside = int(run.tally.violations)
            print(f"{name}, {label}: {error:.2e} rad, {step:.3f} N m, {outside} samples outside", flush=True)
            rows[name].append(f"{error:.1e}, {outside} outside" if outside else f"{error:.1e}")
            steps[name].append(f"{step:.2f}")
    head = [
        "true arm",
        *(f"{name} [rad]" for name in SHAPES),
        *(f"torque step, {name} [N m]" for name in SHAPES),
    ]
    write_table(PAGE, "unmodelled-friction", table(head, [[*row, *steps[name]] for name, row in rows.items()]))
