"""The two sides of a real-time loop, control law and arm, with their settings and their clock; needs no JAX.

Ticks are the sample instants of the loop, numbered from 0.
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from .shared_memory import Arena, CodePlan

SECOND = 1_000_000_000
"""A second in ns."""

_ABSOLUTE, _MONOTONIC = 1, 1
_TIMER_SLACK, _DEATH_SIGNAL, _KILL = 29, 1, 9
_ALL_MEMORY = 3
"""MCL_CURRENT | MCL_FUTURE on Linux."""


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def now() -> int:
    """Time of the monotonic clock [ns], common to all processes of a machine."""
    if sys.platform == "win32":
        return time.monotonic_ns()
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class Sleeper:
    """Sleeps until absolute times, so that one late wake-up does not shift later ones."""

    def __init__(self) -> None:
        self._time = _Timespec()
        self._reference = ctypes.byref(self._time)
        self._sleep = None
        if sys.platform == "linux":
            self._sleep = ctypes.CDLL(None).clock_nanosleep

    def until(self, when: int) -> None:
        """Sleep until time `when` [ns, on the clock of `now`]; return at once if it has passed."""
        if self._sleep is None:
            left = when - now()
            if left > 0:
                time.sleep(left / SECOND)
            return
        self._time.seconds, self._time.nanoseconds = divmod(when, SECOND)
        while self._sleep(_MONOTONIC, _ABSOLUTE, self._reference, None):
            pass  # Interrupted by a signal.


@dataclass(frozen=True)
class RealTimeGrant:
    """The real-time properties that the system granted.

    - `priority`: real-time priority (SCHED_FIFO); None for an ordinary process.
    - `locked`: True if the memory of the process stays in RAM (mlockall).
    - `absolute`: True if the process sleeps until absolute times (clock_nanosleep).
    """

    priority: int | None
    locked: bool
    absolute: bool


def request_real_time(priority: int) -> RealTimeGrant:
    """Request real-time priority (1 to 99) and locked memory, and stop garbage collection.

    On Linux, the process also ends when its parent process ends. Returns the granted properties.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    if sys.platform != "linux":
        return RealTimeGrant(None, False, False)
    system = ctypes.CDLL(None, use_errno=True)
    system.prctl(_DEATH_SIGNAL, _KILL, 0, 0, 0)
    # Without this, a timer without real-time priority may be 50 µs late, to save power.
    system.prctl(_TIMER_SLACK, 1, 0, 0, 0)
    locked = system.mlockall(_ALL_MEMORY) == 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return RealTimeGrant(None, locked, True)
    return RealTimeGrant(priority, locked, True)


KEPT_ROWS = 8192
"""Capacity of a ring buffer [rows]: at 1 kHz, a recorder may be delayed by eight seconds."""

STOP = -1
"""Time stamp of a command by which the law requests that the arm brakes."""


@dataclass(frozen=True)
class MemoryLayout:
    """Layout of the memory that both processes of a loop share: the offset of each part [bytes].

    - `measurements`, `commands`: the mailboxes from the arm to the law, and back.
    - `law_rows`, `arm_rows`: the ring buffers with the log rows of law and arm.
    - `start`: two int64: the time of tick 0 by the monotonic clock [ns], 0 until it is set; and a flag, which ends both
      processes if it is not 0.
    - `size`: total size [bytes].
    """

    measurements: int
    commands: int
    law_rows: int
    arm_rows: int
    start: int
    size: int


@dataclass(frozen=True)
class LoopJob:
    """Settings for one side of the loop, law or arm, which its process receives.

    - `plan`: machine code and memory of the side.
    - `places`: layout of the shared memory.
    - `lengths`: lengths of a measurement, a command, a log row of the law and a log row of the arm [bytes].
    - `period`: time between two ticks [s].
    - `ticks`: number of the last tick.
    - `patience`: largest number of successive ticks without a command in time; at one more, the arm brakes. The law
      ends if a measurement is overdue by more than this number of periods.
    - `phase`: time from a tick to the law's wake-up [ns].
    - `priority`: real-time priority to request, 1 to 99.
    - `world`: for an arm in MuJoCo, its model, and the indices of the joints' positions and velocities; else None.
    - `substeps`: MuJoCo steps per tick.
    - `stop_bit`: mask of the bit in the law's status that makes the arm brake; 0 for none.
    """

    plan: CodePlan
    places: MemoryLayout
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
class SideReport:
    """Report of one side, law or arm, after its loop has ended.

    - `reason`: "done" after the last tick, or "stopped" by the flag in the shared memory. For the law also "no
      measurement". For the arm also "no command" and "stop requested", after which it braked, and "not finite" for its
      joint positions.
    - `granted`: real-time properties of the process.
    - `counts`: event counters by name, as listed in `run_arm` and `run_law`.
    """

    reason: str
    granted: RealTimeGrant
    counts: dict[str, int]


class LawSide:
    """The law's side of a loop: it computes a torque command from each measurement.

    A command takes effect at a tick. If it arrives too late, the arm holds the previous torque. The law's memory (its
    internal state) then contains a command that the arm did not apply. Therefore each measurement carries the tick of
    the last applied command, and the law continues from its memory after this command. For the law, the tick of the
    late command is a lost sample.

    - `plan`: machine code and memory of the law, with two copies of the law's memory. The routine `motion` computes the
      reference at time `t`. `step_0` computes a command and the next memory from the first copy, and writes it to the
      second; `step_1` does so from the second to the first.
    - `period`: time between two ticks [s].
    """

    def __init__(self, plan: CodePlan, period: float) -> None:
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
        """Compute the torque command `tau` from the measurement in `measured`.

        Returns True if the law continued from its memory right after the command of tick `applied`; False if it no
        longer had this memory and continued from an older one.

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
        """Compute the command for a logged sample again; the result is as in `answer`.

        - `sample`: time, measurement and reference, as bytes.
        - `k`, `basis`: from the logged row: the tick of the command, and the tick of the last applied command.
        """
        self._k[()] = k
        self._sample[:] = sample
        return self.answer(k, basis)


World = tuple[Any, np.ndarray, np.ndarray]
"""MuJoCo's model, and the indices of the joints' positions and velocities in it."""


class ArmSide:
    """The arm's side of a loop: an arm that is simulated tick by tick.

    - `plan`: machine code and memory of the arm. The routine `set` applies a torque, and `measure` measures. `move`
      simulates up to the next tick; with MuJoCo, it computes the joint forces to apply in one MuJoCo step.
    - `world`: MuJoCo's model, and the indices of the joints' positions and velocities; None for slidax's own simulator.
    - `substeps`: MuJoCo steps per tick.
    """

    def __init__(self, plan: CodePlan, world: World | None, substeps: int) -> None:
        self.arena = Arena(plan)
        self._set, self._measure, self._move = (self.arena.routine(name) for name in ("set", "measure", "move"))
        view = self.arena.view
        self._k, self._i, self._brakes = (view(name) for name in ("k", "i", "brakes"))
        self._tick, self._applied, self._braking = (view(name) for name in ("true_k", "applied", "braking"))
        self.tau, self.fresh, self.q, self.dq = (view(name) for name in ("tau", "fresh", "q", "dq"))
        self.measured, self.row = self.arena.region("measured"), self.arena.region("row")
        pairs = ("delivery", "sensor", "state")
        self._pairs = {name: (self.arena.region(name), self.arena.region(f"{name}_after")) for name in pairs}
        self._world, self._substeps, self._force = world, substeps, view("force")
        for _ in range(2):
            for routine in (self._set, self._measure, self._move):
                routine()
        self.arena.reset()
        self.braking = False
        self._applied[()] = -1
        if world is not None:
            import mujoco

            self._simulator: Any = mujoco
            self._data = mujoco.MjData(world[0])
            self._data.qpos[world[1]], self._data.qvel[world[2]] = self.q, self.dq

    def set(self, k: int, arrived: bool) -> None:
        """Apply the torque in `tau` at tick `k` if its command arrived in time; otherwise hold the previous torque."""
        self._k[()] = self._tick[()] = k
        self._brakes[()] = self._braking[()] = self.braking
        if arrived:
            self._applied[()] = k
        self._set()
        before, after = self._pairs["delivery"]
        before[:] = after

    def measure(self, k: int) -> bool:
        """Write the measurement at tick `k` to `measured`; return False if it is lost on the way to the law."""
        self._k[()] = k
        self._measure()
        before, after = self._pairs["sensor"]
        before[:] = after
        return bool(self.fresh)

    def move(self) -> bool:
        """Simulate to the next tick; return True if all joint positions are finite."""
        if self._world is None:
            self._move()
            before, after = self._pairs["state"]
            before[:] = after
        else:
            model, indices, dofs = self._world
            for i in range(self._substeps):
                self._i[()] = i
                self._move()
                self._data.qfrc_applied[dofs] = self._force
                self._simulator.mj_step(model, self._data)
                self._data.qpos.take(indices, out=self.q, mode="clip")
                self._data.qvel.take(dofs, out=self.dq, mode="clip")
        return bool(np.isfinite(self.q).all())

    @property
    def rests(self) -> bool:
        """True if all joint speeds are below 1e-3 rad/s or m/s."""
        return bool(np.abs(self.dq).max() < 1e-3)
