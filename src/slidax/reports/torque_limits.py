"""Torque limits of a scenario."""

from __future__ import annotations

import numpy as np

from slidax.scenarios import Scenario


def torque_limits(scenario: Scenario) -> np.ndarray | None:
    """Largest torque of the actuator of a `scenario` [n], N m or N; None if unlimited."""
    actuator = scenario.plant.actuator
    if actuator is None:
        return None
    limits = np.broadcast_to(np.asarray(actuator.limits.torque), scenario.plant.robot.joints)
    return limits if np.isfinite(limits).any() else None
