"""Cause in simulation alone: integration steps too long for friction."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from slidax.robots import Articulated
from slidax.scenarios import Scenario

from ..cause import AbstractCause, Finding, Remedy
from ..record import Record

STABLE = {"rk4": 2.78, "semi_implicit_euler": 2.0}
"""The largest step times rate at which friction still decays in an integrator."""


class Substeps(AbstractCause):
    """Friction changes faster than a step of the integrator can follow.

    Near rest friction is `(f_c/v_s + f_v) q̇`, which decays at that slope over the inertia. This is about the simulation
    and not about the law, so that the plant is looked at.
    """

    name: ClassVar[str] = "substeps"

    def finding(self, record: Record) -> Finding | None:
        ratio_and_joint = coarseness(record.scenario)
        if ratio_and_joint is None or ratio_and_joint[0] <= 1.0:
            return None
        ratio, joint = ratio_and_joint
        simulation = record.scenario.description.simulation
        more = int(np.ceil(2.0 * ratio)) * simulation.substeps
        step = 1e3 * simulation.period / simulation.substeps
        evidence = (
            f"{record.named(joint)}: a step of {step:.3g} ms is {ratio:.2g} times as long as the integrator "
            "needs to follow "
            "the simulated friction near rest"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.96,
            evidence=evidence,
            numbers={"ratio": ratio, "substeps": float(simulation.substeps)},
            remedies=[Remedy("integrate in smaller steps", {"simulation.substeps": min(more, 10_000)})],
        )


def coarseness(scenario: Scenario) -> tuple[float, int] | None:
    """Step length over the longest stable one for the plant's friction, and the joint with the largest ratio."""
    simulation, robot = scenario.description.simulation, scenario.plant.robot
    if simulation.plant != "own" or not isinstance(robot, Articulated):
        return None
    slope = np.asarray(robot.coulomb) / float(robot.smoothing) + np.asarray(robot.viscous)
    inverse = np.linalg.inv(np.asarray(robot.mass(scenario.state0.q)))
    rates, modes = np.linalg.eig(inverse @ np.diag(slope))
    fastest = int(np.argmax(np.abs(rates)))
    step = simulation.period / simulation.substeps
    ratio = float(np.abs(rates[fastest])) * step / STABLE[simulation.integrator]
    return ratio, int(np.argmax(np.abs(modes[:, fastest])))
