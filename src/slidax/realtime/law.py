"""The controller's side: from a measurement to a command, with a memory that follows what the arm really did."""

from __future__ import annotations

import numpy as np

from .arena import Arena, Plan


class Law:
    """A law that answers measurements one by one.

    A command sets in at a tick. If it came too late, the arm has held its last torque, and what the law remembers of
    its own command is wrong: so each measurement says which command set in last, and the law goes on from what it
    remembered after that one. To the law the tick is then one whose sample was lost.

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
        self._given = self.arena.region("given")
        self.tau = self.arena.region("tau")
        self._k, self._basis, self._t = (self.arena.view(name) for name in ("k", "basis", "t"))
        for _ in range(2):
            # Once for nothing, so that all pages of the code are there.
            self._motion()
            for step in self._steps:
                step()
        self.begin()

    def begin(self) -> None:
        """Forgets all; the first command is that for tick 0."""
        self.arena.reset()
        self._at, self._kept, self._pending = 0, -1, -1
        self.look_ahead(0)

    def look_ahead(self, k: int) -> None:
        """Computes the reference of a tick before its measurement has come.

        - `k`: the tick.
        """
        self._k[()] = k
        self._t[()] = k * self._period
        self._motion()

    def answer(self, k: int, applied: int) -> bool:
        """The command for a tick, in `tau`, from what is in `measured`; returns whether its memory is one that it has.

        - `k`: the tick at which the command sets in.
        - `applied`: the last tick whose command set in, as the arm says; -1 before the first.
        """
        if self._k != k:
            self.look_ahead(k)
        if applied == self._pending:
            self._at, self._kept = 1 - self._at, applied
        self._pending = k
        self._basis[()] = self._kept
        self._steps[self._at]()
        return applied == self._kept

    def repeat(self, given: np.ndarray, k: int, basis: int) -> bool:
        """The same with measurement, time and reference as a log has them; returns whether there is such a memory.

        - `given`: time, measurement and reference, as bytes.
        - `k`, `basis`: of the row.
        """
        self._k[()] = k
        self._given[:] = given
        return self.answer(k, basis)
