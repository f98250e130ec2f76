"""The same motion, slower."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..cause import Remedy
from ..record import Record

FACTORS = (0.7, 0.5)
"""Of the speed."""


def slower(record: Record) -> list[Remedy]:
    """The motion at a part of its speed, where its kind has a number for that."""
    motion: Any = record.scenario.description.trajectory
    remedies = []
    for factor in FACTORS:
        changes = {}
        for name, power in (("frequency", 1.0), ("times", -1.0), ("rates", 1.0)):
            value = getattr(motion, name, None)
            if value is not None:
                numbers = np.round(np.asarray(value, float) * factor**power, 6)
                changes[f"trajectory.{name}"] = numbers.tolist()
        if changes:
            remedies.append(Remedy(f"go {1.0 - factor:.0%} slower", changes))
    return remedies
