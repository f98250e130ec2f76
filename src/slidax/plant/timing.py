"""Timing of real controller managers: update periods from public reports, and the resulting lost samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np


class TimingTrace(NamedTuple):
    """A sequence of measured periods between a controller's updates, which repeats.

    - `source`: the public report with the numbers.
    - `nominal`: the configured period [s]; the mean if the report does not state it.
    - `periods`: the sequence of periods in the report [s].
    - `every`: nominal periods from the start of a sequence to the start of the next one; updates between two sequences
      are on time. None repeats the sequence without a pause. The reports do not state this number.
    """

    source: str
    nominal: float
    periods: tuple[float, ...]
    every: int | None = None

    def lost(self) -> np.ndarray:
        """Return the pattern of lost samples: True for each of its p nominal periods without an update [p].

        The pattern repeats. It begins with sample 0, which is not lost.
        """
        ends = np.cumsum(self.periods) / self.nominal
        length = self.every or max(round(float(ends[-1])), 1)
        on_time = np.arange(np.floor(ends[-1]) + 1.0, length + 1.0)
        # Printed times have few digits: an update at the end of a period belongs to it.
        updated = np.ceil(np.concatenate([ends, on_time]) - 1e-6).astype(int)
        lost = np.ones(length, bool)
        lost[updated[updated <= length] - 1] = False
        return np.roll(lost, 1)


TRACES: Mapping[str, TimingTrace] = {
    "uneven": TimingTrace(
        "ros2_control issue 1574: a Raspberry Pi 5 that lags behind",
        4.2072e-3,
        (8.312e-3, 0.71e-3, 6.19e-3, 1.56e-3, 5.4e-3, 1.83e-3, 5.79e-3, 3.91e-3, 3.07e-3, 5.3e-3),
    ),
    "stalls": TimingTrace(
        "ros2_control issue 808: 6.1 ms instead of 1 ms on a real-time kernel, then two updates at once",
        1e-3,
        (6.116648e-3, 0.089013e-3, 0.026079e-3),
        every=1000,
    ),
    "skips": TimingTrace("ros2_control issue 1769: every second update of 2 ms is skipped", 2e-3, (4e-3,)),
    "overruns": TimingTrace(
        "ros2_control issue 2808: a loop of 3.3 ms instead of 2 ms whenever a user interface lists the controllers",
        2e-3,
        (3.327106e-3,),
        every=500,
    ),
}
"""Timing traces by name. Only whole periods without an update count as lost. For the age of measurements in the other
periods, use `Delayed.jitter`.
"""
