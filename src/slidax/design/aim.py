"""Return the objective of the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .trials import Worst

CALM = 0.97
"""Of the torque step that is allowed, since other cases show some more."""

DRIVEN = 0.97
"""Of what the drives can do in a period, that is allowed: at their limit a plan is not carried out."""

OWN = 0.9
"""Of what its own drive can do in a period, that a joint may use where a certificate is required: that begins after the
last limit, and its cases are not the common ones."""

CALMNESS = 0.5
"""The weight of the torque step beside the error, where neither is required: half the error is worth four times the
step."""

NARROW, HARDLY = 0.1, 0.001
"""The weight of a narrow envelope: half the final radius is worth 7 % of the error, below a required step hardly."""

OUTSIDE, NEAR, WILD, COARSE = 400.0, 300.0, 200.0, 100.0
"""Costs of a law that leaves, or comes too near, or is too wild, or not exact enough: more than any of a law that is
better in that."""


@dataclass(frozen=True)
class Aim:
    """Laws that all cases keep with some room; of those the calm ones; of those the exact ones; of those the best.

    - `step`: largest change of torque that is allowed [N m].
    - `required`: whether it is a requirement, so that below it nothing is gained by less.
    - `error`: the steady error that is small enough, so that below it the calmest is best [rad]; None for none.
    - `room`: of an envelope's width, that the worst case must leave.
    - `own`: of what its own drive can do in a period, that the torque step of each joint may be.
    """

    step: float
    required: bool
    error: float | None
    room: float = 0.0
    own: float = np.inf

    def cost(self, worst: Worst) -> float:
        """The smaller, the better; finite, so that a search finds its way.

        - `worst`: of a candidate law.
        """
        if not worst.holds:
            return OUTSIDE + worst.outside - float(np.clip(worst.margin, -1.0, 1.0))
        if worst.margin < self.room:
            return NEAR - worst.margin
        error, step = np.log(max(worst.error, 1e-300)), np.log(max(worst.step, 1e-12))
        if worst.step > CALM * self.step:
            return WILD + float(step)
        if worst.driven > self.own:
            return WILD + float(np.log(worst.driven))
        if self.error is not None:
            return float(step) if worst.error <= self.error else COARSE + float(error)
        narrow = np.log(float(np.min(worst.choice.final)))
        return float(error + HARDLY * narrow if self.required else error + CALMNESS * step + NARROW * narrow)

    def best(self, candidates: Sequence[Worst]) -> Worst:
        """The one that costs least.

        - `candidates`: judged laws.
        """
        return min(candidates, key=self.cost)

    def stricter(self, share: float) -> Aim:
        """The same with a smaller step: few cases show less of it than many.

        - `share`: of the step.
        """
        return replace(self, step=share * self.step, own=share * self.own)
