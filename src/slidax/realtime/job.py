"""What the processes of a loop are told before it begins, and what they say when it has ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .arena import Plan

KEPT_ROWS = 8192
"""Rows of a ring: eight seconds at 1 kHz, for a recorder that is held up."""

STOP = -1
"""In a command, in place of the time at which it was sent: the law asks the arm to brake."""


@dataclass(frozen=True)
class Places:
    """Where in the shared memory each part begins [bytes].

    - `measurements`, `commands`: the mailboxes.
    - `law_rows`, `arm_rows`: the rings.
    - `start`: time of tick 0 by the monotonic clock [ns], 0 as long as it is not set; after it, whether all is to end.
    - `size`: of all.
    """

    measurements: int
    commands: int
    law_rows: int
    arm_rows: int
    start: int
    size: int


@dataclass(frozen=True)
class Job:
    """One side of the loop.

    - `plan`: its code and numbers.
    - `places`: of the shared memory.
    - `lengths`: bytes of a measurement, a command, a row of the law and a row of the arm.
    - `period`: between two ticks [s].
    - `ticks`: how many.
    - `patience`: ticks without a command, or a measurement, until the loop is over.
    - `phase`: when after a tick the law wakes up [ns].
    - `priority`: real-time priority that is asked for.
    - `world`: for the arm: MuJoCo's model with the places of the joints, or None.
    - `substeps`: MuJoCo's steps in a tick.
    - `stop_bit`: bit of the law's status with which the arm must brake; 0 for none.
    """

    plan: Plan
    places: Places
    lengths: tuple[int, int, int, int]
    period: float
    ticks: int
    patience: int
    phase: int
    priority: int
    world: tuple[Any, Any, Any] | None
    substeps: int
    stop_bit: int = 0


@dataclass(frozen=True)
class Report:
    """What a side says at its end.

    - `reason`: why it ended: "done", "stopped", "no command", "stop requested", "no measurement" or
      "not finite".
    - `priority`, `locked`, `absolute`: as in `Granted`.
    - `counts`: what it counted, by name.
    """

    reason: str
    priority: int | None
    locked: bool
    absolute: bool
    counts: dict[str, int]
