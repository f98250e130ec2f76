"""Tables of docs/identification.md on several logs, loads, gravity, encoders and drives."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import numpy as np

import slidax as sx
from slidax.arms import Articulated, Payload
from slidax.core import as_array
from slidax.core.errors import DefinitionError
from slidax.identify import Identification, JointLog, identify
from slidax.identify.band import arm_parameters
from slidax.identify.mass_bound import MassBound
from tests.identify.recorded import moved

from .identified import ARMS, random_tool, recorded

SECONDS, RATE = 12.0, 250.0
"""Duration [s] and sampling rate [Hz] of a log."""

BLOCK = Payload(mass=as_array(2.0), center=as_array([0.0, 0.0, 0.1]), inertia=as_array(1e-3 * np.diag([3.0, 3.0, 2.0])))
"""The known load of a second log."""


def logged(
    arm: Articulated, seed: int, gains: np.ndarray | None = None, offset: Any = 0.0, seconds: float = SECONDS
) -> JointLog:
    """A log of a random motion, by encoders with an offset and drives with `τ = gains τ_log`."""
    t, motion = moved(seconds, RATE, arm.joints, size=1.0, seed=seed)
    log = recorded(arm, motion, seed)
    tau = log.tau if gains is None else np.linalg.solve(gains, log.tau.T).T
    return replace(log, source=f"log {seed}", t=t, q=log.q - 1e-5 * np.round(offset / 1e-5), tau=tau)


def with_wrong_links(arm: Articulated, random: np.random.Generator) -> Articulated:
    """The arm with each link up to 15 % heavier or lighter than its file says."""
    factor = random.uniform(0.85, 1.15, arm.joints)
    masses, inertias = arm.masses * factor, arm.inertias * factor[:, None, None]
    changed: Articulated = eqx.tree_at(lambda robot: (robot.masses, robot.inertias), arm, (masses, inertias))
    return changed


def carrying(arm: Articulated, payload: Payload) -> Articulated:
    """The arm with another payload."""
    changed: Articulated = eqx.tree_at(lambda robot: robot.payload, arm, payload)
    return changed


def rows_of(result: Identification, names: tuple[str, ...], truth: Any) -> np.ndarray:
    """Error, half of the 95 % interval, and 1 if the log shows it, for each parameter with one of the names, [k 3]."""
    own = [parameter for name in names for parameter in result.parameters if parameter.name == name]
    values = np.array([[each.value, 1.96 * each.standard_error, each.identifiable] for each in own])
    values[:, 0] -= np.ravel(truth)
    return values


def offsets(name: str, number: int, known_payload: bool) -> np.ndarray:
    """Offsets of encoders of up to 40 mrad [mrad]."""
    arm, random = random_tool(name, number), np.random.default_rng(50 + number)
    offset = random.uniform(-0.04, 0.04, arm.joints)
    base = getattr(sx.arms, name)()
    known = carrying(base, arm.payload) if known_payload else base
    result = identify(logged(arm, number, offset=offset), known, encoder_offset=True, payload=not known_payload)
    return rows_of(result, ("encoder_offset",), offset) * [1e3, 1e3, 1.0]


def drives(name: str, number: int, form: str, known_payload: bool) -> np.ndarray:
    """Gains that are off by up to 20 %, and cross-talk of up to 3 % [%]."""
    arm, random = random_tool(name, number), np.random.default_rng(70 + number)
    n = arm.joints
    gains = np.diag(random.uniform(0.8, 1.2, n))
    if form == "full":
        gains = gains + random.uniform(-0.03, 0.03, (n, n)) * (1 - np.eye(n))
    base = getattr(sx.arms, name)()
    known = carrying(base, arm.payload) if known_payload else base
    result = identify(logged(arm, number, gains), known, actuator_map=form, payload=not known_payload)
    crosstalk = tuple(f"crosstalk_{k}" for k in range(n))
    truth = [*np.diag(gains), *(gains[i, k] for k in range(n) for i in range(n) if i != k)]
    names = ("gain", *crosstalk) if form == "full" else ("gain",)
    return rows_of(result, names, truth[: n if form == "gain" else None]) * [100.0, 100.0, 1.0]


def two_loads(name: str, number: int) -> np.ndarray:
    """Gains from a log without a load and one with a known load, with links of up to 15 % other masses [%]."""
    random = np.random.default_rng(90 + number)
    arm = with_wrong_links(random_tool(name, number), random)
    gains = np.diag(random.uniform(0.8, 1.2, arm.joints))
    logs = [
        logged(each, 2 * number + k, gains) for k, each in enumerate((arm, carrying(arm, arm.payload.joined(BLOCK))))
    ]
    base = getattr(sx.arms, name)()
    result = identify(logs, base, loads=[Payload(), BLOCK], links=True, payload=True, actuator_map="gain")
    return rows_of(result, ("gain",), np.diag(gains)) * [100.0, 100.0, 1.0]


def unknown_loads(name: str, number: int) -> np.ndarray:
    """Mass of the unknown load of a second log [g]."""
    arm, other = random_tool(name, number), random_tool(name, 100 + number).payload
    logs = [logged(each, 2 * number + k) for k, each in enumerate((arm, carrying(arm, arm.payload.joined(other))))]
    result = identify(logs, getattr(sx.arms, name)(), loads=[Payload(), None])
    return rows_of(result, ("load_2.mass",), other.mass) * [1e3, 1e3, 1.0]


def mountings(name: str, number: int) -> np.ndarray:
    """Gravity of an arm that is mounted at a random angle [m/s²]."""
    random = np.random.default_rng(30 + number)
    down = random.normal(size=3)
    gravity = 9.81 * down / np.linalg.norm(down)
    arm = eqx.tree_at(lambda robot: robot.gravity_vector, random_tool(name, number), as_array(gravity))
    result = identify(logged(arm, number), getattr(sx.arms, name)(), gravity=True)
    return rows_of(result, ("gravity.x", "gravity.y", "gravity.z"), gravity)


CASES: dict[str, tuple[Callable[[str, int], np.ndarray], str]] = {
    "offsets, unknown payload": (partial(offsets, known_payload=False), "mrad"),
    "offsets, known payload": (partial(offsets, known_payload=True), "mrad"),
    "gains, known payload": (partial(drives, form="gain", known_payload=True), "%"),
    "gains, unknown payload": (partial(drives, form="gain", known_payload=False), "%"),
    "gains and cross-talk, known payload": (partial(drives, form="full", known_payload=True), "%"),
    "gains and cross-talk, unknown payload": (partial(drives, form="full", known_payload=False), "%"),
    "gains, links and payload, from two logs with known loads": (two_loads, "%"),
    "unknown load of a second log": (unknown_loads, "g"),
    "direction of gravity, unknown payload": (mountings, "m/s²"),
}
"""Measured rows: errors of a log, and their unit."""


def measure_instruments() -> None:
    """Identify encoders, drives, loads and gravity on three arms, for docs/identification.md."""
    parser = argparse.ArgumentParser(description=measure_instruments.__doc__)
    parser.add_argument("--logs", type=int, default=4, help="logs per arm, or pairs of logs")
    parser.add_argument("--arms", default=",".join(ARMS), help="comma-separated")
    parser.add_argument("--only", default="", help="words in the rows to measure")
    arguments = parser.parse_args()
    print("| identified | logs | refused | shown | largest error | its 95 % interval | inside | median time [s] |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for title, (errors_of, unit) in CASES.items():
        if arguments.only not in title:
            continue
        blocks, seconds, refused = [], [], 0
        for name in arguments.arms.split(","):
            for number in range(arguments.logs):
                started = time.perf_counter()
                try:
                    blocks.append(errors_of(name, number))
                except DefinitionError as error:
                    print(title, name, number, f"refused: {error}", file=sys.stderr, flush=True)
                    refused += 1
                    continue
                seconds.append(time.perf_counter() - started)
                shares = blocks[-1][:, 0] / blocks[-1][:, 1]
                print(title, name, number, np.round(shares, 2), file=sys.stderr, flush=True)
        rows = np.concatenate(blocks)
        off, half, _ = np.abs(rows[rows[:, 2] > 0.5]).T
        worst, inside = int(np.argmax(off)), int(np.sum(off <= half))
        cells = [title, len(blocks) + refused, refused, f"{len(off)} of {len(rows)}", f"{off[worst]:.2g} {unit}"]
        cells += [f"± {half[worst]:.2g} {unit}", f"{inside} of {len(off)}", f"{np.median(seconds):.2g}"]
        print(f"| {' | '.join(map(str, cells))} |", flush=True)


def results_of(name: str, number: int, seconds: float) -> Iterator[tuple[Articulated, Identification]]:
    """The arm and its identification with links from one, two and four logs."""
    arm = with_wrong_links(random_tool(name, number), np.random.default_rng(90 + number))
    logs = [logged(arm, 4 * number + k, seconds=seconds) for k in range(4)]
    for count in (1, 2, 4):
        yield arm, identify(logs[:count], getattr(sx.arms, name)(), links=True)


def measure_several() -> None:
    """Identify arms with their links from one, two and four logs, for docs/identification.md."""
    parser = argparse.ArgumentParser(description=measure_several.__doc__)
    parser.add_argument("--arms", type=int, default=4, help="random arms of each kind")
    parser.add_argument("--kinds", default=",".join(ARMS), help="comma-separated")
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of a log")
    arguments = parser.parse_args()
    titles = (
        "arm",
        "logs",
        "p, median [%]",
        "true error of M, largest [%]",
        "rotors and friction inside",
        "largest [%]",
    )
    print(f"| {' | '.join(titles)} |\n|---|---:|---:|---:|---:|---:|")
    for name in arguments.kinds.split(","):
        cells: dict[int, list[Any]] = {}
        for number in range(arguments.arms):
            for arm, result in results_of(name, number, arguments.seconds):
                assert result.band is not None
                fitted = arm_parameters(result.robot)
                error = MassBound(result.robot, fitted).of((arm_parameters(arm) - fitted)[None])[0]
                names = ("armature", "coulomb", "viscous")
                truth = np.concatenate([np.asarray(getattr(arm, each)) for each in names])
                rows = rows_of(result, names, truth)
                cells.setdefault(len(result.logs), []).append((result.band.p, error, rows, truth))
                print(name, number, len(result.logs), result.band.p, error, file=sys.stderr, flush=True)
        for count, measured in cells.items():
            p, errors = (100 * np.array([each[k] for each in measured]) for k in (0, 1))
            off, half, visible = np.abs(np.concatenate([each[2] for each in measured])).T
            shown = visible > 0.5
            share = 100 * off / np.concatenate([each[3] for each in measured])
            inside = f"{np.sum(off[shown] <= half[shown])} of {shown.sum()}"
            row = [name, count, f"{np.median(p):.2g}", f"{errors.max():.2g}", inside, f"{share[shown].max():.2g}"]
            print(f"| {' | '.join(map(str, row))} |", flush=True)
