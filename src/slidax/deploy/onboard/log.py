"""Log of a motion as a table; its torques are commands, without the robot's own compensation.

This module runs by itself next to an exported law.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence

from .law import Law, Pilot

PER_JOINT = ("q", "dq", "tau", "q_wanted", "dq_wanted", "error")


class Log:
    """Rows in memory, written when the motion is over: no file is touched while the arm moves."""

    def __init__(self, law: Law) -> None:
        joints = range(1, law.joints + 1)
        self.columns = ["time", *(f"{name}_{k}" for name in PER_JOINT for k in joints)]
        self.columns += ["margin", "status", "phase", "success_rate"]
        self.rows: list[tuple[float, ...]] = []

    def add(self, pilot: Pilot, q: Sequence[float], dq: Sequence[float], success_rate: float = 1.0) -> None:
        """Add one period after the pilot's step.

        - `success_rate`: of the link to the robot, as counted by the robot.
        """
        report, wanted = pilot.report, pilot.reference
        self.rows.append(
            (
                report.t,
                *q,
                *dq,
                *report.tau,
                *wanted.q,
                *wanted.dq,
                *report.error,
                report.margin,
                report.status,
                report.phase,
                success_rate,
            )
        )

    def column(self, name: str) -> list[float]:
        """One column, such as `q_1`."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the table as CSV."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            writer.writerows(self.rows)
