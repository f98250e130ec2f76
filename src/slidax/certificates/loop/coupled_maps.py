"""All joints as one loop, with their coupling given by a matrix K."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop

from ..each import Floats


@dataclass(frozen=True)
class CoupledMaps:
    """One period of all loops: `ë = K (a + w*)`, with a the command of each joint's law; units of periods.

    The states of the joints' own loops (`LinearLoop.maps`) follow each other, and `rows` has its rows for each joint.

    - `step`: [S S]; `rows`: [7 n S].
    - `enters`: from each joint's noise of position and velocity, target, disturbance and disturbance at the end [5 S
      n]; `direct`: the same to the rows [5 7 n n]. A disturbance w* acts through K.
    - `own`: number of states of one joint.
    """

    step: Floats
    rows: Floats
    enters: Floats
    direct: Floats
    own: int

    @classmethod
    def of(cls, loops: Sequence[LinearLoop], matrix: Floats, delay: float | None = None) -> CoupledMaps:
        """Maps of the joints' loops.

        - `loops`: with one horizon and delay.
        - `matrix`: K [n n].
        - `delay`: the true one [periods]; the law's own if None.
        """
        n = len(loops)
        still, moved = [loop.maps(0.0, delay) for loop in loops], [loop.maps(1.0, delay) for loop in loops]
        own = still[0].step.shape[0]
        step, rows = np.zeros((n, own, n, own)), np.zeros((7, n, n, own))
        enters, direct = np.zeros((5, n, own, n)), np.zeros((5, 7, n, n))
        for i in range(n):
            step[i, :, i], rows[:, i, i] = still[i].step, still[i].outputs
            enters[:3, i, :, i] = still[i].enters.T[:3]
            direct[:3, :, i, i] = still[i].direct.T[:3]
            for j in range(n):
                # Joint j's command moves joint i.
                share = matrix[i, j]
                step[i, :, j] += share * (moved[j].step - still[j].step)
                rows[:, i, j] += share * (moved[j].outputs - still[j].outputs)
                enters[:3, i, :, j] += share * (moved[j].enters - still[j].enters).T[:3]
                direct[:3, :, i, j] += share * (moved[j].direct - still[j].direct).T[:3]
                enters[3:, i, :, j] = share * still[i].enters.T[3:]
                direct[3:, :, i, j] = share * still[i].direct.T[3:]
        size = n * own
        return cls(step.reshape(size, size), rows.reshape(7, n, size), enters.reshape(5, size, n), direct, own)

    def states(self, which: NDArray[np.integer[Any]]) -> CoupledMaps:
        """The maps of some states only."""
        step, rows, enters = self.step[np.ix_(which, which)], self.rows[..., which], self.enters[:, which]
        return CoupledMaps(step, rows, enters, self.direct, self.own)

    @property
    def joints(self) -> int:
        return int(self.rows.shape[1])

    @property
    def radius(self) -> float:
        """The largest modulus of an eigenvalue over one period; below 1 the loops are stable."""
        return float(np.max(np.abs(np.linalg.eigvals(self.step))))

    def placed(self, states: Floats, joint: int) -> Floats:
        """States of one joint's loop [s m] as states of all [S m], with the others at rest."""
        placed = np.zeros((self.step.shape[0], states.shape[1]))
        placed[joint * self.own : (joint + 1) * self.own] = states
        return placed
