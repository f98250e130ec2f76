"""Limits from an arm's data sheet."""

from __future__ import annotations

import numpy as np

from slidax.robots import Articulated, Coupled

from ..record import Record


def data_sheet(record: Record, name: str) -> np.ndarray:
    """A limit of the joints by the arm's description [n]; 0 where it has none.

    - `name`: `torque` or `torque_rate`.
    """
    robot = record.nominal
    if not isinstance(robot, Articulated | Coupled):
        return np.zeros(record.joints)
    limit = np.asarray(getattr(robot.limits, name))
    return np.where(np.isfinite(limit), limit, 0.0)
