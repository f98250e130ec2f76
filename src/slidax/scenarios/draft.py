"""Draft of a scenario for an arm, with a reason for each choice (`slidax new`)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import relpath
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from slidax.arms.articulated import Articulated
from slidax.arms.built_in import built_in_arm, built_in_names
from slidax.arms.coupled import Coupled
from slidax.arms.files.find_arm import find_arm
from slidax.arms.files.inertias import REPLACED
from slidax.arms.files.mjcf import from_mjcf
from slidax.arms.files.robot_descriptions import description_file, is_description
from slidax.arms.files.urdf import from_urdf
from slidax.core.errors import DefinitionError, DefinitionWarning, as_array, nearest_word, percent
from slidax.simulation.states import Numbers

from .draft_choices import Motion, Ratings, home_of, motion_about, ratings_of, tip_share
from .load import parse
from .scenario import Scenario
from .yaml_text import dump_commented

RADIUS = 5.0
"""rad/s: final radius of the envelope, over the period; the radius is 0.005 rad at 1 kHz, 0.02 rad at 250 Hz."""

WIDTH = {"rad": 1.0, "m": 0.2}
"""rad or m: initial radius of the envelope; it also scales the final radius of a prismatic joint."""

HORIZON, PERIODS = 25e-3, 12
"""s and periods: lower bounds of the horizon H."""

RATE = 20.0
"""1/s: torque rate limit over torque limit; a drive reaches its largest torque in 1/20 s."""

RESOLUTION = 1e-5
"""rad or m: encoder resolution, 19 bits per turn."""

DRIFT = 0.008
"""1/√s: √(torque density) over the torque limit, the relative drift of the disturbance in a second."""

SURFACE = {"k1": 0.5, "k2": 1.0, "p": 0.5, "q": 1.2, "delta": 0.01}
REACHING = {"gain": 0.1, "exponent": 1.2, "layer": 0.0}
OVERSHOOT, EXPONENT = 0.9, 2.01
"""Parameters of the law in new scenarios, and in designs before their search."""

SUBSTEPS = 10


@dataclass(frozen=True)
class Choices:
    """Choices for a new scenario or requirements file.

    - `arm`: the arm as described by its file or data sheet.
    - `block`: the scenario's block `robot`.
    - `rate`: loop rate, Hz.
    - `ratings`, `home`, `motion`: ratings of the joints, home posture, and motion about it.
    - `payload`: mass at the tip that the law does not know, kg.
    - `horizon`: planning horizon of the law, s.
    - `notes`: assumptions, each a sentence.
    """

    arm: Articulated
    block: Mapping[str, Any]
    rate: float
    ratings: Ratings
    home: Numbers
    motion: Motion
    payload: float
    horizon: float
    notes: tuple[str, ...]


ROTORS = 0.002
"""kg m² per N m of rated torque: rotor inertia of the simulated arm, since every drive has a rotor."""


def draft_text(chosen: Choices) -> str:
    """Return the YAML text of a scenario file with these choices."""
    units, period = chosen.arm.joint_units, 1.0 / chosen.rate
    ratings, motion = chosen.ratings, chosen.motion
    wide = [WIDTH[unit] for unit in units]
    narrow = [RADIUS * period * WIDTH[unit] for unit in units]
    values = {
        "title": f"{chosen.arm.name} at {chosen.rate:g} Hz",
        "robot": {**chosen.block, "plant": {"armature": _row(_rotors(chosen)), **_load(chosen)}},
        **_task(chosen),
        "start": {"q": _row(motion.start)},
        "scheme": {
            "name": "cftsmppc",
            "performance": {
                "kind": "fixed_time",
                "initial": _each(wide),
                "final": _each(narrow),
                "deadline": 2.0,
                "exponent": EXPONENT,
            },
            "overshoot": OVERSHOOT,
            "surface": SURFACE,
            "reaching": REACHING,
            "sampled_data": {
                "horizon": _number(chosen.horizon),
                "estimator": {"kind": "kalman", "torque_density": _row((DRIFT * ratings.torque) ** 2)},
            },
        },
        "simulation": {
            "mode": "held",
            "integrator": "semi_implicit_euler",
            "period": float(f"{period:.9g}"),
            "substeps": SUBSTEPS,
            "t1": 8.0,
            "outside": "recover",
        },
    }
    return dump_commented(values, _comments(chosen))


def _task(chosen: Choices) -> dict[str, Any]:
    """Blocks for the motion, the sensors and the drives."""
    motion, torque, rate = chosen.motion, chosen.ratings.torque, chosen.ratings.torque_rate
    return {
        "trajectory": {
            "kind": "sinusoid",
            "offset": _row(chosen.home),
            "amplitude": _row(motion.amplitude),
            "frequency": _row(motion.frequency),
        },
        "sensor": {"resolution": RESOLUTION, "velocity": "differenced", "delay": 1},
        "actuator": {"torque": _row(torque), "rate": _row(np.minimum(RATE * torque, rate))},
    }


def _load(chosen: Choices) -> dict[str, Any]:
    return {"load": {"mass": _number(chosen.payload)}} if chosen.payload else {}


FRICTION = 0.01
"""Coulomb friction of a new requirements file, as a share of the torque limit."""


def requirements_text(chosen: Choices) -> str:
    """Return the YAML text of a requirements file for `slidax design` with these choices."""
    torque = chosen.ratings.torque
    friction = _row(FRICTION * torque)
    payload = {"robot.plant.load.mass": {"between": [0, _number(chosen.payload)]}} if chosen.payload else {}
    values = {
        "title": f"{chosen.arm.name} at {chosen.rate:g} Hz",
        "robot": {
            **chosen.block,
            "plant": {"armature": _row(_rotors(chosen)), "coulomb": friction, **_load(chosen)},
        },
        **_task(chosen),
        "simulation": {"period": float(f"{1.0 / chosen.rate:.9g}"), "substeps": SUBSTEPS},
        "uncertainty": {
            **payload,
            "robot.plant.mass_factor": {"around": "10 %"},
            "robot.plant.armature": {"around": "50 %", "each": "joint"},
            "robot.plant.coulomb": {"around": "50 %", "each": "joint"},
            "start.q": {"around": 0.05 * min(WIDTH[unit] for unit in chosen.arm.joint_units), "each": "joint"},
        },
        "requirements": {"deadline": 2.0, "accuracy": "best"},
    }
    shared = [(path, text) for path, text in _comments(chosen) if path in ("robot", "trajectory", "sensor", "actuator")]
    own = [
        (
            "robot.plant",
            f"The true arm: rotor inertias of {ROTORS:g} kg m² per N m, unless the robot's file has them, and Coulomb "
            f"friction of {percent(FRICTION)} of the torque limits. The law does not know them."
            f"{_payload_frame(chosen)}",
        ),
        ("uncertainty", "Assumed ranges: replace them by yours. The design is tested in random cases within them."),
        (
            "requirements",
            "The error is within its final radius from the deadline [s] on. `best` is the smallest radius that holds; "
            "a number [rad or m] is a requirement. `proof: bound` requires a certified bound.",
        ),
    ]
    return dump_commented(values, shared + own)


def _payload_frame(chosen: Choices) -> str:
    """Return a sentence about the payload's frame; empty without a payload."""
    if not chosen.payload:
        return ""
    frame = f"the tip `{chosen.block['tip']}`" if "tip" in chosen.block else "the flange"
    return (
        f" The payload of {chosen.payload:g} kg has its centre of mass at the origin of {frame}; load: {{center: [x, "
        "y, z]} moves it [m]."
    )


def _rotors(chosen: Choices) -> Numbers:
    """Return the rotor inertias of the simulated arm: from the robot's file, otherwise from the rated torques."""
    rotors = np.asarray(chosen.arm.armature)
    return np.where(rotors > 0.0, rotors, ROTORS * chosen.ratings.torque)


def _comments(chosen: Choices) -> Iterator[tuple[str, str]]:
    """Yield the path of each key with its comment."""
    if chosen.notes:
        yield "robot", "\n".join(["Assumptions:", *(f"- {note}" for note in chosen.notes)])
    yield (
        "robot.plant",
        f"Differences of the true arm that the law does not know: rotor inertias of {ROTORS:g} kg m² per N m, unless "
        "the robot's file has them. More examples: mass_factor: 0.85, coulomb: 0.5, load: {mass: 1.0, center: [0.0, "
        "0.0, 0.05]}. The law learns the rotor inertias, unless nominal: {armature: ...} has them (kg m², on the "
        f"joint's side).{_payload_frame(chosen)}",
    )
    yield (
        "trajectory",
        f"Joints {', '.join(chosen.arm.joint_names)} move around a posture inside their ranges and away from "
        f"singularities. They use up to {int(100 * max(chosen.motion.burden))} % of the torque limits below with a "
        f"payload of {int(100 * tip_share(chosen.arm, chosen.payload))} % of the arm's mass.",
    )
    yield "sensor", "Rounded positions without velocities, delayed by one period."
    yield (
        "actuator",
        f"Torque and rate limits. Rate limits that the arm's description lacks are assumed: full torque in "
        f"{1e3 / RATE:g} ms.",
    )
    yield "start", "The arm starts at rest, away from the trajectory."
    yield (
        "scheme.performance",
        "The error is within `final` from the deadline on. `final` can be smaller with a shorter period "
        "(docs/loop-rate.md).",
    )
    yield "scheme.sampled_data", "`bound` is computed from the arm, its torque limits and the mismatch above."
    yield (
        "scheme.sampled_data.horizon",
        "The horizon is long: with a payload, light wrists have several times the model's inertia (docs/loop-rate.md).",
    )
    yield (
        "scheme.sampled_data.estimator",
        "Density of the white noise that drives the disturbance: a larger one makes the estimate faster, but also "
        "noisier.",
    )


def _number(value: float) -> float:
    return float(f"{value:.6g}")


def _row(values: Numbers) -> list[float]:
    return [_number(value) for value in values]


def _each(values: list[float]) -> float | list[float]:
    numbers = [_number(value) for value in values]
    return numbers[0] if len(set(numbers)) == 1 else numbers


SLOWEST, FASTEST = 20.0, 20_000.0
"""Hz: allowed loop rates."""

FILES = {".urdf": "urdf", ".xacro": "urdf", ".xml": "mjcf", ".mjcf": "mjcf"}


@dataclass(frozen=True)
class Draft:
    """A new scenario or requirements file.

    - `text`: content of the file.
    - `notes`: assumptions, each a sentence.
    """

    text: str
    notes: tuple[str, ...]


def draft(
    robot: str | Path,
    rate: float = 1000.0,
    *,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    inertias: str | None = None,
    gravity: Sequence[float] | None = None,
    payload: float = 0.0,
    requirements: bool = False,
    folder: str | Path = Path(),
) -> Draft:
    """Return a commented scenario for an arm, which can be simulated without changes.

    - `robot`: name of a built-in arm, path of a URDF or MJCF file, or a module of robot_descriptions.
    - `rate`: loop rate, Hz.
    - `tip`: link, body or site at the end of the arm; None to search for it.
    - `locked`: further joints that do not move, with their positions [rad or m].
    - `inertias`: "nearest" replaces inertias that no rigid body can have, "strict" refuses them; None: as "nearest".
    - `gravity`: gravity in the base frame [3], m/s², such as for an arm on a wall; None: from the arm's description.
    - `payload`: mass at the tip of the simulated arm that the law does not know, kg.
    - `requirements`: True for a requirements file of `slidax design` in place of a scenario.
    - `folder`: folder of the scenario file, to which the robot file's path is relative.

    Raises DefinitionError if the robot does not exist, the file has no single arm, the rate is out of range, or the
    arm cannot hold the payload.
    """
    if not (math.isfinite(rate) and SLOWEST <= rate <= FASTEST):
        raise DefinitionError(f"the rate must be {SLOWEST:g} to {FASTEST:g} Hz; got {rate:g}")
    if not (math.isfinite(payload) and payload >= 0):
        raise DefinitionError(f"the payload must be >= 0 kg; got {payload:g}")
    arm, block, notes = _arm(str(robot), tip, dict(locked or {}), inertias, Path(folder))
    if gravity is not None:
        if len(gravity) != 3 or not all(map(math.isfinite, gravity)):
            raise DefinitionError(f"the gravity must be three numbers, such as 0,0,-9.81; got {list(gravity)}")
        arm = eqx.tree_at(lambda arm: arm.gravity_vector, arm, as_array(list(gravity)))
        block["nominal"] = {"gravity": [float(each) for each in gravity]}
    ratings = ratings_of(arm)
    share = tip_share(arm, payload)
    home = home_of(arm, ratings, share)
    motion = motion_about(arm, ratings, home, share)
    notes = (*notes, *ratings.notes)
    chosen = Choices(arm, block, rate, ratings, home, motion, payload, max(HORIZON, PERIODS / rate), notes)
    if requirements:
        return Draft(requirements_text(chosen), notes)
    if payload:
        chosen = _with_tried_horizon(chosen, Path(folder))
    return Draft(draft_text(chosen), chosen.notes)


FACTORS = (1.0, 0.75, 1.5, 0.5)
"""Horizons that are tried with a payload, as multiples of the default."""

ENOUGH = 0.1
"""Envelope margin of a run, as a share of the envelope's width, that ends the search for a horizon."""


def _with_tried_horizon(chosen: Choices, folder: Path) -> Choices:
    """Return the choices with a horizon that holds the payload in a simulation; the best one if none does.

    A payload that couples the joints of a light wrist narrows the range of horizons that hold.
    """
    margins: dict[float, float] = {}
    for factor in FACTORS:
        horizon = _number(factor * chosen.horizon)
        scenario = parse(draft_text(replace(chosen, horizon=horizon)), folder=folder).build(chosen.arm.name)
        margins[horizon] = float(np.min(scenario.simulate(log_every=None, progress=False).tally.margin))
        if margins[horizon] >= ENOUGH:
            break
    best = max(margins, key=lambda horizon: margins[horizon])
    if best == chosen.horizon and margins[best] > 0.0:
        return chosen
    tried = ", ".join(f"{1e3 * horizon:g}" for horizon in margins)
    result = (
        f"the simulated run has a margin of {percent(margins[best])} of the envelope's width"
        if margins[best] > 0.0
        else "the simulated run still leaves the envelope: choose a lighter payload, or widen the envelope"
    )
    note = f"the horizon is {1e3 * best:g} ms, the best of {tried} ms with this payload; {result}"
    return replace(chosen, horizon=best, notes=(*chosen.notes, note))


def new(
    robot: str | Path,
    rate: float = 1000.0,
    *,
    tip: str | None = None,
    locked: Mapping[str, float] | None = None,
    inertias: str | None = None,
    gravity: Sequence[float] | None = None,
    payload: float = 0.0,
) -> Scenario:
    """Build the scenario that `slidax new` writes for an arm; it can be simulated without changes.

        scenario = slidax.new("arm.urdf", rate=500)

    - `robot`, `rate`, `tip`, `locked`, `inertias`, `gravity`, `payload`: as in `draft`. A warning lists the assumptions
      that replace missing data.

    Raises DefinitionError as `draft` does.
    """
    drafted = draft(robot, rate, tip=tip, locked=locked, inertias=inertias, gravity=gravity, payload=payload)
    if drafted.notes:
        warnings.warn(f"assumed: {'; '.join(drafted.notes)}", DefinitionWarning, stacklevel=2)
    return parse(drafted.text).build(Path(robot).stem)


def _arm(
    robot: str, tip: str | None, locked: dict[str, float], inertias: str | None, folder: Path
) -> tuple[Articulated, dict[str, Any], tuple[str, ...]]:
    """Return the arm, its block `robot` for a scenario, and notes about assumptions."""
    if robot in built_in_names():
        if tip is not None or locked or inertias is not None:
            raise DefinitionError(
                f"`{robot}` is built in; `tip`, `locked` and `inertias` are only for robot files: leave them out"
            )
        return built_in_arm(robot).robot, {"kind": robot}, ()
    notes: list[str] = []
    path = Path(robot)
    if is_description(robot):
        path = description_file(robot)
        notes.append(f"`{robot}` is read from the cache of robot_descriptions; copy its file to keep it")
    kind = FILES.get(path.suffix.lower())
    if kind is None:
        known = ", ".join(FILES)
        raise DefinitionError(
            f"`{robot}` is neither a built-in arm nor a file ({known}); {nearest_word(robot, built_in_names())}"
        )
    chain = find_arm(path, tip)
    read = from_urdf if kind == "urdf" else from_mjcf
    how: Any = inertias or "nearest"
    with warnings.catch_warnings(record=True) as assumed:
        warnings.simplefilter("always")
        arm = read(path, tip=chain.tip, locked=chain.locked | locked, inertias=how)
    if isinstance(arm, Coupled):
        raise DefinitionError(_with_followers(arm, kind, path, chain.tip))
    messages = [str(warning.message).removeprefix(f"{path}: ") for warning in assumed]
    changed = [message for message in messages if message.startswith(REPLACED)]
    notes += changed
    notes += [message for message in messages if message.endswith("left out")]
    block: dict[str, Any] = {"kind": kind, "file": relpath(path, folder), "tip": chain.tip}
    if chain.locked or locked:
        block["locked"] = {name: float(f"{value:.6g}") for name, value in (chain.locked | locked).items()}
    if held := [name for name in chain.locked if name not in locked]:
        notes.append(
            f"{', '.join(held)}: not part of the arm with tip `{chain.tip}`; held at the position in its range nearest "
            "to 0"
        )
    if changed or inertias is not None:
        block["inertias"] = how
    return arm, block, tuple(notes)


def _with_followers(arm: Coupled, kind: str, path: Path, tip: str) -> str:
    """Error message, with a remedy, for an arm with joints that follow others."""
    follower = arm.followers[0]
    carrier = arm.arm.parents[arm.arm.joint_names.index(follower)]
    link = arm.arm.link_names[carrier]
    shorter = f"`--tip {link}` ends the arm before this joint and holds it; or " if carrier >= 0 else ""
    return (
        f"joint `{follower}` of `{path}` follows another joint, and `slidax new` chooses no motion for such an arm; "
        f"{shorter}write the scenario by hand with `robot: {{kind: {kind}, file: {path.name}, tip: {tip}}}`"
    )
