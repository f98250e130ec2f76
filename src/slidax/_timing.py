"""Timing of a control loop."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Timing:
    """Sample time of a control loop, and the delays in it.

    - `period`: time between two samples [s].
    - `delay`: age of a measurement when it arrives [periods].
    - `dead_time`: time between a command and its torque [periods].
    """

    period: float
    delay: float
    dead_time: float

    @property
    def total_delay(self) -> float:
        """Age of a measurement when its torque acts [periods]."""
        return self.delay + self.dead_time

    @property
    def whole_periods(self) -> int:
        """The total delay, rounded to whole periods."""
        return round(self.total_delay)
