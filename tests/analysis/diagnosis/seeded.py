"""Runs that leave their envelope for one reason each, and a scenario's law without what would hide it."""

from __future__ import annotations

from typing import Any

from slidax.scenarios import Scenario, load
from slidax.scenarios.sampled_data import SampledDataDescription

PANDA = "panda-payload"
ESTIMATOR = "scheme.sampled_data.estimator"
UNLEARNT: dict[str, Any] = (
    {"scheme.sampled_data.adaptation": None} if "adaptation" in SampledDataDescription.model_fields else {}
)
"""A law that learns its arm's inertia would hold where these are to fail."""

SEEDED: dict[str, tuple[str, dict[str, Any], str]] = {
    "too light a model": (PANDA, {"robot.nominal.armature": 0.01, "robot.plant.armature": 0.1}, "inertia"),
    "too heavy a model": (PANDA, {"robot.plant.armature": 0.02}, "inertia"),
    "torque limit": (PANDA, {"actuator.torque": [87, 50, 40, 25, 12, 12, 12]}, "torque"),
    "torque rate limit": (PANDA, {"actuator.rate": 100}, "torque_rate"),
    "robust torque": (PANDA, {"scheme.bound.margin": 1.0}, "robust_torque"),
    "long period": (
        PANDA,
        {"simulation.period": 1.6e-2, "simulation.substeps": 40, "scheme.sampled_data.horizon": None},
        "period",
    ),
    "coarse substeps": (
        PANDA,
        {"simulation.period": 8e-3, "simulation.substeps": 1, "scheme.sampled_data.horizon": None},
        "substeps",
    ),
    "heavy payload": ("ur5e-payload", {"robot.plant.load.mass": 10.0}, "payload"),
    "slow estimator": (PANDA, {f"{ESTIMATOR}.torque_density": 1e-8}, "estimator"),
    "delay": (PANDA, {"sensor.delay": 4, "scheme.sampled_data.delay": 1}, "delay"),
    "coarse encoder": (PANDA, {"sensor.resolution": 1e-3}, "encoder"),
    "contact": ("panda-table", {"surroundings.table.height": 0.5353}, "contact"),
}
"""By what is wrong: a scenario, what is changed in it, and the cause that is to be named."""


def seeded(which: str) -> Scenario:
    base, changes, _ = SEEDED[which]
    return load(base, UNLEARNT | changes)
