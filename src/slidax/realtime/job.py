"""Messages between the processes of a loop at its start and its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .arena import Plan

KEPT_ROWS = 8192
"""Rows of a ring: eight seconds at 1 kHz, for a recorder that is held up."""

STOP = -1
"""In a command, instead of the time at which it was sent: the law asks the arm to brake."""


@dataclass(frozen=True)
class Places:
    """Layout of the shared memory: the start of each part [bytes].

    - `measurements`, `commands`: the mailboxes.
    - `law_rows`, `arm_rows`: the rings.
    - `start`: time of tick 0 by the monotonic clock [ns], 0 until it is set; then a flag that ends both processes.
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

    - `lengths`: bytes of a measurement, a command, a row of the law and a row of the arm.
    - `period`: between two ticks [s].
    - `ticks`: length of the loop.
    - `patience`: ticks without a command, or without a measurement, that end the loop.
    - `phase`: wake-up of the law after a tick [ns].
    - `priority`: real-time priority to request.
    - `world`: for the arm: MuJoCo's model with the joints' indices, or None.
    - `substeps`: MuJoCo's steps in a tick.
    - `stop_bit`: status bit of the law with which the arm must brake; 0 for none.
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
    """A side's report at its end.

    - `reason`: "done", "stopped", "no command", "stop requested", "no measurement" or "not finite".
    - `priority`, `locked`, `absolute`: as in `Granted`.
    - `counts`: event counters, by name.
    """

    reason: str
    priority: int | None
    locked: bool
    absolute: bool
    counts: dict[str, int]
