"""The loops of a scenario's joints, as its law believes them to be."""

from __future__ import annotations

import numpy as np

from slidax.controllers import SampledData
from slidax.scenarios import Scenario

from .linear_loop import LinearLoop


def loops_of(scenario: Scenario) -> tuple[LinearLoop | None, ...]:
    """Each joint's loop near its goal; None where its estimator is not linear.

    - `scenario`: with a law in sampled-data form.
    """
    law, sensor = scenario.controller, scenario.description.sensor
    assert isinstance(law, SampledData)
    differenced = sensor.instrument is None and sensor.velocity == "differenced"
    cutoffs = np.broadcast_to(np.asarray(sensor.cutoff, float), law.joints)
    return tuple(
        LinearLoop.of(law, joint, float(cutoffs[joint]) if differenced else None) for joint in range(law.joints)
    )
