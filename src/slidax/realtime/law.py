"""The law's side of a loop: from a measurement to a command, with a memory that follows the torques really applied."""

from __future__ import annotations

import numpy as np

from .arena import Arena, Plan


class Law:
    """A law that answers measurements one by one.

    A command takes effect at a tick. If it arrives too late, the arm holds its previous torque, and the law's memory of
    its own command is wrong. Therefore each measurement carries the number of the last command applied, and the law
    continues from its memory after that command. The law treats such a tick as a lost sample.

    - `plan`: its code: `motion` from `t` to the reference; `step_0`, `step_1` from one of two memories to the other.
    - `period`: between two ticks [s].
    """

    def __init__(self, plan: Plan, period: float) -> None:
        self.arena = Arena(plan)
        self._period = period
        self._motion = self.arena.routine("motion")
        self._steps = [self.arena.routine("step_0"), self.arena.routine("step_1")]
        self.row = self.arena.region("row")
        self.measured = self.arena.region("measured")
        self._sample = self.arena.region("sample")
        self.tau = self.arena.region("tau")
        self._k, self._basis, self._t = (self.arena.view(name) for name in ("k", "basis", "t"))
        for _ in range(2):
            # A dry run loads all pages of the code.
            self._motion()
            for step in self._steps:
                step()
        self.begin()

    def begin(self) -> None:
        """Reset the law; its first command is for tick 0."""
        self.arena.reset()
        self._at, self._kept, self._pending = 0, -1, -1
        self.look_ahead(0)

    def look_ahead(self, k: int) -> None:
        """Compute the reference of tick `k` before its measurement arrives."""
        self._k[()] = k
        self._t[()] = k * self._period
        self._motion()

    def answer(self, k: int, applied: int) -> bool:
        """Compute the command in `tau` from `measured`; return False if the memory to continue from is not available.

        - `k`: the tick at which the command takes effect.
        - `applied`: the last tick whose command was applied, as reported by the arm; -1 before the first.
        """
        if self._k != k:
            self.look_ahead(k)
        if applied == self._pending:
            self._at, self._kept = 1 - self._at, applied
        self._pending = k
        self._basis[()] = self._kept
        self._steps[self._at]()
        return applied == self._kept

    def repeat(self, sample: np.ndarray, k: int, basis: int) -> bool:
        """Answer a logged sample again; return False if the memory to continue from is not available.

        - `sample`: time, measurement and reference, as bytes.
        - `k`, `basis`: of the logged row.
        """
        self._k[()] = k
        self._sample[:] = sample
        return self.answer(k, basis)
