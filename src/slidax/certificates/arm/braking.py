"""Acceleration that the drives leave for braking, and the states from which it suffices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.controllers import SampledData
from slidax.scenarios import Scenario

from ..each import Floats
from .members import Members
from .motion import Belief, Motion, kinds_of, needed
from .ratios import INSTANTS
from .width import width_along

BRAKING_FACTOR = 1.6
"""Default of `Recovery`."""


@dataclass(frozen=True)
class Braking:
    """Braking capability along the motion.

    - `acceleration`: a of each joint, while the others follow the motion [n], rad/s² or m/s²; inf without limits, 0
      where nothing is left.
    - `lead`: c, s.
    """

    acceleration: Floats
    lead: float

    def room(self, error: Floats, rate: Floats) -> Floats:
        """Half width of the envelope in which an error can be braked [n]: `1.6 (|e| + c |ė| + ė²/(2a))`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.where(rate > 0, rate * rate / (2.0 * self.acceleration), 0.0)
        return BRAKING_FACTOR * (error + self.lead * rate + way)

    def speed(self, scenario: Scenario) -> Floats:
        """The largest |ė| at e = 0 that can be braked within the final envelope: `v²/(2a) + c v <= ρ∞` [n]."""
        width = width_along(scenario, np.array([scenario.t1]))
        if width is None:
            return np.full_like(self.acceleration, np.inf)
        a, c = self.acceleration, self.lead
        with np.errstate(invalid="ignore"):
            braked = np.sqrt((a * c) ** 2 + 2.0 * a * width[0]) - a * c
        return np.where(np.isfinite(a), braked, width[0] / c)


def room_to_brake(scenario: Scenario, members: Members, limit: Floats, torque: Floats) -> Braking:
    """Return the drives' reserve, `a_i = (τ_max,i - max |τ_i|)/max M_ii` over motion and members.

    The inertia is the largest at the ends of the set, or M0's.

    - `limit`: of the torques [n].
    - `torque`: the largest along the motion over the set [n].
    """
    motion = Motion.of(scenario)
    belief = Belief.of(scenario, members.plant)
    few = motion.every(INSTANTS)
    masses = [belief.mass_and_bias(few.t, few.q, few.dq)[0][None]]
    masses.append(needed(kinds_of(members.plants(members.ends()))[0], few)[0])
    heaviest = np.diagonal(np.concatenate(masses), axis1=2, axis2=3).max(axis=(0, 1))
    law = scenario.controller
    horizon = float(law.horizon) if isinstance(law, SampledData) and law.horizon is not None else scenario.period
    return Braking(np.maximum(limit - torque, 0.0) / heaviest, horizon - 0.5 * scenario.period)
