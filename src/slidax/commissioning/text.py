"""Text of a new scenario, with the reason for each choice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from slidax.robots import Articulated
from slidax.scenarios.written import dump_commented
from slidax.simulation.states import Numbers

from .motion import Motion
from .ratings import Ratings

RADIUS = 5.0
"""rad/s: final radius of the envelope over the period, 0.005 rad at 1 kHz, 0.02 rad at 250 Hz."""

WIDTH = {"rad": 1.0, "m": 0.2}
"""rad or m: initial radius; the final radius of a prismatic joint is smaller by the same factor."""

HORIZON, PERIODS = 25e-3, 12
"""s and periods: lower bounds of the horizon H."""

RATE = 20.0
"""1/s: torque rate over torque limit; a drive reaches its largest torque in 1/20 s."""

RESOLUTION = 1e-5
"""rad or m: encoder resolution, 19 bits per turn."""

DRIFT = 0.008
"""1/√s: √(torque density) over the torque limit, the drift of the disturbance in one second."""

SURFACE = {"k1": 0.5, "k2": 1.0, "p": 0.5, "q": 1.2, "delta": 0.01}
REACHING = {"gain": 0.1, "exponent": 1.2, "layer": 0.0}
OVERSHOOT, EXPONENT = 0.9, 2.01
"""Law of new scenarios, and of designs before their search."""

SUBSTEPS = 10


@dataclass(frozen=True)
class Choices:
    """Choices for a new scenario.

    - `block`: the description of the robot.
    - `rate`: Hz.
    - `notes`: assumptions.
    """

    arm: Articulated
    block: Mapping[str, Any]
    rate: float
    ratings: Ratings
    home: Numbers
    motion: Motion
    notes: tuple[str, ...]


ROTORS = 0.002
"""kg m² for each N m of rated torque: rotor inertia of the simulated arm, since every drive has a rotor."""


def draft_text(chosen: Choices) -> str:
    """Return the text of the file."""
    units, period = chosen.arm.joint_units, 1.0 / chosen.rate
    ratings, motion = chosen.ratings, chosen.motion
    wide = [WIDTH[unit] for unit in units]
    narrow = [RADIUS * period * WIDTH[unit] for unit in units]
    values = {
        "title": f"{chosen.arm.name} at {chosen.rate:g} Hz",
        "robot": {**chosen.block, "plant": {"armature": _row(ROTORS * ratings.torque)}},
        "trajectory": {
            "kind": "sinusoid",
            "offset": _row(chosen.home),
            "amplitude": _row(motion.amplitude),
            "frequency": _row(motion.frequency),
        },
        "sensor": {"resolution": RESOLUTION, "velocity": "differenced", "delay": 1},
        "actuator": {"torque": _row(ratings.torque), "rate": _row(RATE * ratings.torque)},
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
                "horizon": _number(max(HORIZON, PERIODS * period)),
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


def _comments(chosen: Choices) -> Iterator[tuple[str, str]]:
    """Yield the path of each key with its comment."""
    if chosen.notes:
        yield "robot", "\n".join(["Assumptions:", *(f"- {note}" for note in chosen.notes)])
    yield (
        "robot.plant",
        f"Differences of the true arm, which the law does not know: its rotors, {ROTORS:g} kg m² for each N m. For "
        "example also mass_factor: 0.85, coulomb: 0.5, load: {mass: 1.0, center: [0.0, 0.0, 0.05]}. The law learns the "
        "rotors, unless nominal: {armature: ...} gives them (kg m², seen from the joint).",
    )
    yield (
        "trajectory",
        f"Joints {', '.join(chosen.arm.joint_names)}: around a posture inside their ranges, away from singular ones, "
        f"with up to {int(100 * max(chosen.motion.burden))} % of the torques below if 20 % of the arm's mass is at the "
        "tip.",
    )
    yield "sensor", "Positions only, rounded, one period old when they arrive."
    yield (
        "actuator",
        f"Torque limits and rate limits. The robot's file has no rates: from 0 to the limit in {1e3 / RATE:g} ms.",
    )
    yield "start", "At rest, off the motion."
    yield (
        "scheme.performance",
        "The error is within `final` from the deadline on; a shorter period allows a smaller one (docs/loop-rate.md).",
    )
    yield "scheme.sampled_data", "`bound` is missing: it follows from the arm, its torques and the mismatch above."
    yield (
        "scheme.sampled_data.horizon",
        "Long: with a load, light wrists are several times as heavy as in the law's model (docs/loop-rate.md).",
    )
    yield (
        "scheme.sampled_data.estimator",
        "Density of the white noise that drives the disturbance: a larger one follows it faster, and passes on more of "
        "the encoders' noise.",
    )


def _number(value: float) -> float:
    return float(f"{value:.6g}")


def _row(values: Numbers) -> list[float]:
    return [_number(value) for value in values]


def _each(values: list[float]) -> float | list[float]:
    numbers = [_number(value) for value in values]
    return numbers[0] if len(set(numbers)) == 1 else numbers
