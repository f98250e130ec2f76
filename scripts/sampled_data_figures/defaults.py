"""The table of docs/sampled-data.md on default gains: 3200 runs, which take some minutes."""

from __future__ import annotations

import numpy as np

from .loops import table, write_table
from .sudden_changes import CHANGES, DELAYS, RATES, SCENARIOS, SENSORS, Setting, diverging, largest_errors, simulated

ARMS = 10
SEED = 38


def make() -> None:
    """Writes the table."""
    rows = []
    for rate in RATES:
        for delay in DELAYS:
            row, count, horizon = [], 0, 0.0
            for sensor in SENSORS:
                largest = []
                for name in SCENARIOS:
                    setting = Setting(name, rate, sensor, delay)
                    run = simulated(setting, ARMS, SEED)
                    count += int(np.sum(diverging(setting, run)))
                    horizon = 1e3 * float(setting.load().controller.horizon)
                    largest.append(largest_errors(run)[2].reshape(ARMS, len(CHANGES)).max(axis=0))
                row += [f"{x:.1e}" for x in np.max(largest, axis=0)]
            rows.append([f"{rate}", f"{delay}", f"{horizon:.3g}", *row, f"{count}"])
    short = ("nothing", "half torque", "2 kg", "push")
    head = ["rate [Hz]", "D", "H [ms]", *(f"{sensor}: {one}" for sensor in SENSORS for one in short), "diverge"]
    write_table("sampled-data.md", "defaults", table(head, rows))
