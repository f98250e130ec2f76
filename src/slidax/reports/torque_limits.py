"""The torque limits of an arm."""

from __future__ import annotations

import numpy as np

from slidax.scenarios import Scenario


def torque_limits(scenario: Scenario) -> np.ndarray | None:
    """The largest torque that the scenario's actuator allows, [n], N m or N; None if it has no limit.

    - `scenario`: whose actuator.
    """
    actuator = scenario.plant.actuator
    if actuator is None:
        return None
    limits = np.broadcast_to(np.asarray(actuator.limits.torque), scenario.plant.robot.joints)
    return limits if np.isfinite(limits).any() else None
