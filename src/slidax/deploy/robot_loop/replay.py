"""A log through its law again: the same measurements must give the same torques, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, counted
from slidax.logs import SavedLog, flags
from slidax.realtime import Law
from slidax.scenarios import of_log

from .law_plan import law_plan

COMPARED = ("tau", "status")
"""What must be the same bits."""


@dataclass(frozen=True)
class Difference:
    """The first answer that is another one.

    - `tick`, `t`: when [s].
    - `joint`: which joint's torque is farthest off, from 0 on; None if only the status differs.
    - `logged`, `again`: its torque [N m or N].
    - `status`: the bits in the log, and again.
    """

    tick: int
    t: float
    joint: int | None
    logged: float
    again: float
    status: tuple[int, int]


@dataclass(frozen=True)
class Replay:
    """What became of a log.

    - `answers`: how many were compared.
    - `same`: how many of them are the same bits.
    - `first`: the first that is not; None if all are.
    - `largest`: how far any torque is off [N m or N].
    - `joints`: their names.
    - `bits`: names of the status's bits.
    - `unknown`: answers that went on from one that is not in the log, and were not compared.
    """

    answers: int
    same: int
    first: Difference | None
    largest: float
    joints: tuple[str, ...]
    bits: tuple[str, ...]
    unknown: int

    def sentence(self) -> str:
        """In words."""
        said = f"{self.same} of {counted(self.answers, 'answer')} have the same bits"
        if self.unknown:
            said += f" ({self.unknown} more go on from an answer that the log has lost)"
        if self.first is None:
            return f"{said}."
        one = self.first
        what = (
            f"{self.joints[one.joint]} was commanded {one.logged!r}, and is now {one.again!r}, "
            f"{abs(one.again - one.logged):.2g} off"
            if one.joint is not None
            else "the torques are the same, the status is not"
        )
        was, is_ = ("+".join(flags(self.bits, status)) or "OK" for status in one.status)
        status = "" if was == is_ else f"; status {was}, and now {is_}"
        return (
            f"{said}; the first other one is at tick {one.tick}, t = {one.t:g} s: {what}{status}. "
            f"At most, a torque is {self.largest:.2g} off."
        )

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        one = self.first
        first = None
        if one is not None:
            first = {
                "tick": one.tick,
                "t": one.t,
                "joint": None if one.joint is None else self.joints[one.joint],
                "logged": one.logged,
                "again": one.again,
                "status": list(one.status),
            }
        return {
            "answers": self.answers,
            "same": self.same,
            "first": first,
            "largest": self.largest,
            "unknown": self.unknown,
        }


def replay(log: SavedLog) -> Replay:
    """Each measurement of a log through the law of its scenario again, from the memory that the law had then.

    - `log`: with an answer of the law in it.

    Raises DefinitionError if it has none, its scenario is invalid or its law has other signals, or llvmlite is missing.
    """
    scenario = of_log(log)
    plan = law_plan(scenario)
    rows = len(log.law["k"])
    if not rows:
        raise DefinitionError(f"`{log.path}` has no answers of a law in it")
    if plan.channels != log.channels:
        raise DefinitionError(f"`{log.path}` has other joints or signals than the law of its own scenario")
    law = Law(plan.plan, scenario.period)
    given = np.zeros(rows, plan.given)
    for name in plan.given.names or ():
        given[name] = log.law[name]
    inputs = given.view(np.uint8).reshape(rows, -1)
    again = np.zeros((rows, law.row.size), np.uint8)
    known = np.ones(rows, bool)
    for row, (k, basis) in enumerate(zip(log.law["k"].tolist(), log.law["basis"].tolist(), strict=True)):
        known[row] = law.repeat(inputs[row], k, basis)
        again[row] = law.row
    if not known.all():
        # After one that is lost nothing is as it was.
        known[int(np.argmin(known)) :] = False
    found = plan.columns(again)
    wrong = np.zeros(rows, bool)
    for name in COMPARED:
        differs = found[name].view(f"u{found[name].itemsize}") != log.law[name].view(f"u{log.law[name].itemsize}")
        wrong |= differs.reshape(rows, -1).any(axis=1)
    wrong &= known
    off = np.abs(found["tau"] - log.law["tau"])[known]
    return Replay(
        answers=int(known.sum()),
        same=int((known & ~wrong).sum()),
        first=_first(log.law, found, int(np.argmax(wrong))) if wrong.any() else None,
        largest=float(np.nanmax(off, initial=0.0)),
        joints=log.channels.joints,
        bits=log.channels.bits,
        unknown=int((~known).sum()),
    )


def _first(logged: dict[str, np.ndarray], again: dict[str, np.ndarray], row: int) -> Difference:
    off = np.abs(again["tau"][row] - logged["tau"][row])
    joint = None if not off.any() else int(np.argmax(off))
    return Difference(
        tick=int(logged["k"][row]),
        t=float(logged["t"][row]),
        joint=joint,
        logged=float(logged["tau"][row][joint or 0]),
        again=float(again["tau"][row][joint or 0]),
        status=(int(logged["status"][row]), int(again["status"][row])),
    )
