"""The loop of a robot without a clock: each side waits for the other. Equals the simulated run up to rounding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from slidax.logs import Channels
from slidax.realtime import Arm, Law

from .arm_plan import arm_plan
from .law_plan import law_plan

if TYPE_CHECKING:
    from slidax.scenarios import Scenario


@dataclass(frozen=True)
class Stepped:
    """Columns of a loop: one row per answer of the law, and one per tick of the arm."""

    channels: Channels
    law: dict[str, np.ndarray]
    arm: dict[str, np.ndarray]


def lockstep(scenario: Scenario, samples: int, *, transport: int = 0) -> Stepped:
    """Run the loop sample by sample, in the machine code that a robot would call.

    - `transport`: as in `arm_plan`; 1 reproduces two processes without any delay.

    Raises DefinitionError if the scenario does not allow it or llvmlite is not installed; NoNativeCodeError if there is
    no machine code for something in it.
    """
    of_law, of_arm = law_plan(scenario), arm_plan(scenario, transport=transport)
    law = Law(of_law.plan, scenario.period)
    arm = Arm(of_arm.plan, of_arm.world, of_arm.substeps)
    torque = law.tau.view(float)
    answers, ticks = [], []
    applied = -1
    fresh = True
    for k in range(samples):
        if not transport:
            fresh = arm.measure(k)
        if fresh:
            law.measured[:] = arm.measured
            law.answer(k, applied)
            answers.append(law.row.copy())
            arm.tau[:] = torque
            applied = k
        arm.set(k, fresh)
        if transport:
            fresh = arm.measure(k)
        ticks.append(arm.row.copy())
        arm.move()
    return Stepped(of_law.channels, of_law.columns(np.stack(answers)), of_arm.columns(np.stack(ticks)))
