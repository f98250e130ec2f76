"""Sensor noise of a scenario: as a bound, and in probability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slidax.scenarios import Scenario

from ..each import Floats


@dataclass(frozen=True)
class Noise:
    """Noise of a measured position and velocity, each joint; rad or m, and rad/s or m/s.

    - `position`: rounding bound, r/2 [n].
    - `position_deviation`, `velocity_deviation`: σ of the normal noise [n].
    """

    position: Floats
    position_deviation: Floats
    velocity_deviation: Floats

    @classmethod
    def of(cls, scenario: Scenario, joints: int) -> Noise:
        """The noise of a scenario's encoders."""
        sensor = scenario.description.sensor
        levels = (sensor.resolution, sensor.position_noise, sensor.velocity_noise)
        resolution, position, velocity = (np.broadcast_to(np.asarray(level, float), joints) for level in levels)
        return cls(0.5 * resolution, position, velocity)

    @property
    def random(self) -> bool:
        """True if some noise is unbounded."""
        return bool(np.any(self.position_deviation) or np.any(self.velocity_deviation))

    def size(self, period: float, sums: Floats, squares: Floats, times: int, chance: float) -> Floats:
        """Bound of the noise's effect on each output at all times, except with a probability `chance` [7 n j].

        `r/2 Σ|g| + λ √(σ_q² Σ g_q² + σ_v² Σ g_v²)`, `λ = √(2 ln(2 times/chance))`: the first term always holds, the
        second because a sum of independent normal numbers is normal, and by a union bound over the times.

        - `period`: h [s].
        - `sums`, `squares`: of the responses' sizes, to positions and velocities in units of periods [2 7 n j].
        - `times`: number of samples, joints and outputs.
        """
        spread = np.sqrt(
            (self.position_deviation**2)[None, :, None] * squares[0]
            + ((period * self.velocity_deviation) ** 2)[None, :, None] * squares[1]
        )
        return self.position[None, :, None] * sums[0] + self.deviations(times, chance) * spread

    def start(self, period: float, times: int, chance: float) -> tuple[Floats, Floats]:
        """Noise of the first measurement alone: position [n], rad or m, and velocity [n], rad or m per period."""
        factor = self.deviations(times, chance)
        return self.position + factor * self.position_deviation, factor * period * self.velocity_deviation

    def deviations(self, times: int, chance: float) -> float:
        """λ: number of standard deviations that no sample exceeds, except with a probability `chance`."""
        return math.sqrt(2.0 * math.log(2.0 * times / chance)) if self.random else 0.0
