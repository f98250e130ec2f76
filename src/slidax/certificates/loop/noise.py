"""What the sensors of a scenario add to what they measure: as a bound, and in probability."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.scenarios import Scenario

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Noise:
    """Of a measured position and velocity, each joint; rad or m, and rad/s or m/s.

    - `position`: bound of what rounding does, r/2 [n].
    - `position_deviation`, `velocity_deviation`: σ of what is random and normal [n].
    """

    position: Floats
    position_deviation: Floats
    velocity_deviation: Floats

    @classmethod
    def of(cls, scenario: Scenario, joints: int) -> Noise:
        """That of a scenario's encoders.

        - `scenario`: whose.
        - `joints`: how many.
        """
        sensor = scenario.description.sensor
        given = (sensor.resolution, sensor.position_noise, sensor.velocity_noise)
        resolution, position, velocity = (np.broadcast_to(np.asarray(one, float), joints) for one in given)
        return cls(0.5 * resolution, position, velocity)

    @property
    def random(self) -> bool:
        """Whether some of it has no bound."""
        return bool(np.any(self.position_deviation) or np.any(self.velocity_deviation))

    def size(self, period: float, sums: Floats, squares: Floats, times: int, chance: float) -> Floats:
        """How much of it arrives at each output, at any of so many times, but for a chance [7 n j].

        `r/2 Σ|g| + λ √(σ_q² Σ g_q² + σ_v² Σ g_v²)`, `λ = √(2 ln(2 times/chance))`: the first for sure, the second since
        a sum of independent normal numbers is normal, and by the union over the times.

        - `period`: h [s].
        - `sums`, `squares`: of the responses' sizes, to positions and velocities in units of periods [2 7 n j].
        - `times`: at how many samples, joints and outputs.
        - `chance`: that it is more at one of them.
        """
        spread = np.sqrt(
            (self.position_deviation**2)[None, :, None] * squares[0]
            + ((period * self.velocity_deviation) ** 2)[None, :, None] * squares[1]
        )
        return self.position[None, :, None] * sums[0] + self.deviations(times, chance) * spread

    def start(self, period: float, times: int, chance: float) -> tuple[Floats, Floats]:
        """Of the first measurement alone: position [n], rad or m, and velocity [n], rad or m per period."""
        factor = self.deviations(times, chance)
        return self.position + factor * self.position_deviation, factor * period * self.velocity_deviation

    def deviations(self, times: int, chance: float) -> float:
        """λ, how many standard deviations are not exceeded at any of so many times, but for a chance."""
        return math.sqrt(2.0 * math.log(2.0 * times / chance)) if self.random else 0.0
