"""Text of a new scenario, with the reason for each choice."""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import fill

import numpy as np

from slidax.robots import Articulated
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

SUBSTEPS = 10


@dataclass(frozen=True)
class Choices:
    """Choices for a new scenario.

    - `block`: lines of `robot`.
    - `rate`: Hz.
    - `notes`: assumptions.
    """

    arm: Articulated
    block: tuple[str, ...]
    rate: float
    ratings: Ratings
    home: Numbers
    motion: Motion
    notes: tuple[str, ...]


ROTORS = 0.002
"""kg m² for each N m of rated torque: rotor inertia of the simulated arm, since every drive has a rotor."""


def written(chosen: Choices) -> str:
    """Return the text of the file."""
    units, period = chosen.arm.joint_units, 1.0 / chosen.rate
    ratings, motion = chosen.ratings, chosen.motion
    wide = [WIDTH[unit] for unit in units]
    narrow = [RADIUS * period * WIDTH[unit] for unit in units]
    horizon = max(HORIZON, PERIODS * period)
    assumed = "".join(_comment(f"- {note}") for note in chosen.notes)
    block = "\n".join(f"  {line}" for line in chosen.block)
    burden = int(100 * max(motion.burden))
    return f"""title: {chosen.arm.name} at {chosen.rate:g} Hz

{_comment("Assumptions:") + assumed if assumed else ""}
robot:
{block}
  # Differences of the true arm, unknown to the law. Its drives have rotors, {ROTORS:g} kg m² for each N m;
  # also, for instance, mass_factor: 0.85, coulomb: 0.5, load: {{mass: 1.0, center: [0.0, 0.0, 0.05]}}
  plant: {{armature: {_row(ROTORS * ratings.torque)}}}
  # Rotors (kg m², seen from the joint) that are known: nominal: {{armature: ...}}. Unknown ones are learnt.

# Joints {", ".join(chosen.arm.joint_names)}: about a posture inside their ranges, away
# from singular ones, with up to {burden} % of the torques below when 20 % of the arm's mass is at the tip.
trajectory:
  kind: sinusoid
  offset: {_row(chosen.home)}
  amplitude: {_row(motion.amplitude)}
  frequency: {_row(motion.frequency)}

# Positions alone, rounded, one period old when they arrive.
sensor: {{resolution: {RESOLUTION:.1e}, velocity: differenced, delay: 1}}

# Largest torques, and how fast they change: from 0 to the largest in {1e3 / RATE:g} ms, as the file says nothing of it.
actuator:
  torque: {_row(ratings.torque)}
  rate: {_row(RATE * ratings.torque)}

# Off its motion, at rest.
start: {{q: {_row(motion.start)}}}

scheme:
  name: cftsmppc
  # The error is inside of this radius from the deadline on; a shorter period allows a narrower one (docs/loop-rate.md).
  performance: {{kind: fixed_time, initial: {_each(wide)}, final: {_each(narrow)}, deadline: 2.0, exponent: 2.01}}
  overshoot: 0.9
  surface: {{k1: 0.5, k2: 1.0, p: 0.5, q: 1.2, delta: 0.01}}
  reaching: {{gain: 0.1, exponent: 1.2, layer: 0.0}}
  # `bound` is not given: it follows from the arm, its torques and the mismatch above.
  sampled_data:
    # Long: what is carried makes light wrists several times as heavy as the law believes (docs/loop-rate.md).
    horizon: {horizon:.6g}
    # As white noise that drives the disturbance: more follows it faster, and passes on more of the encoders' noise.
    estimator: {{kind: kalman, torque_density: {_row((DRIFT * ratings.torque) ** 2)}}}

simulation:
  {{mode: held, integrator: semi_implicit_euler, period: {period:.9g}, substeps: {SUBSTEPS}, t1: 8.0, outside: recover}}
"""


def _comment(text: str) -> str:
    return fill(text, 120, initial_indent="# ", subsequent_indent="#   ", break_on_hyphens=False) + "\n"


def _row(values: Numbers) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"


def _each(values: list[float]) -> str:
    return f"{values[0]:.6g}" if len(set(values)) == 1 else _row(np.array(values))
