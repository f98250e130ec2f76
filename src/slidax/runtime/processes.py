"""Processes of a real-time loop: `python -m slidax.runtime.processes law|arm DESCRIPTOR`.

`DESCRIPTOR` is the file descriptor of the shared memory. Ticks are the sample instants of the loop, numbered from 0.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np

from .shared_memory import Mailbox, Ring, map_shared_memory
from .sides import (
    KEPT_ROWS,
    SECOND,
    STOP,
    ArmSide,
    LawSide,
    LoopJob,
    RealTimeGrant,
    SideReport,
    Sleeper,
    now,
    request_real_time,
)

READY = b"ready\n"


class ProcessContext:
    """Shared memory of the law's or the arm's process, with the start time and the stop flag of the loop.

    - `memory`: the shared memory, as bytes.
    - `job`: settings of the process.
    """

    def __init__(self, memory: np.ndarray, job: LoopJob) -> None:
        self._memory, self._job = memory, job
        self._begins = memory[job.places.start :][:16].view(np.int64)
        self._granted = RealTimeGrant(None, False, False)

    def at(self, offset: int) -> np.ndarray:
        """Return the memory from `offset` [bytes] on."""
        return self._memory[offset:]

    def ready(self) -> None:
        """Request real-time scheduling, and report that this process is ready to start."""
        self._granted = request_real_time(self._job.priority)
        sys.stdout.buffer.write(READY)
        sys.stdout.buffer.flush()

    def started(self) -> int:
        """Wait until the time of tick 0 is set; return it [ns]."""
        while not self._begins[0]:
            time.sleep(1e-3)
        return int(self._begins[0])

    @property
    def stops(self) -> bool:
        """True if all processes must end."""
        return bool(self._begins[1])

    def report(self, reason: str, counts: dict[str, int]) -> SideReport:
        """Return the report of this process; `reason` and `counts` are as in `SideReport`."""
        return SideReport(reason, self._granted, counts)


def run_process(sides: Mapping[str, Callable[[LoopJob, ProcessContext], SideReport]]) -> None:
    """Run the side that the first command-line argument names: read its job from stdin, and write its report to stdout.

    - `sides`: for each name of a side, "law" or "arm", the function that runs it and returns its report.
    """
    job: LoopJob = pickle.load(sys.stdin.buffer)
    report = sides[sys.argv[1]](job, ProcessContext(map_shared_memory(int(sys.argv[2])), job))
    sys.stdout.buffer.write(pickle.dumps(report))
    sys.stdout.buffer.flush()


BRAKES_FOR = 2.0
"""Longest time of braking [s]; by then, the mechanical brakes of a real arm would hold the arm."""


def run_arm(job: LoopJob, context: ProcessContext) -> SideReport:
    """Run the arm's loop: at each tick apply the command, measure, publish, and simulate up to the next tick.

    A command that arrives after its tick is not applied: the arm holds the previous torque for another tick. If this
    process is delayed, it simulates the ticks that have passed, since a real arm would have moved on. Commands sent
    after such a tick do not count as in time. The arm brakes after more than `patience` successive ticks without a
    command in time. It also brakes as soon as the law requests a stop, even by a command that arrives too late.

    The report's counts are

    - `ticks`: simulated ticks;
    - `held`: ticks without a command in time, up to the tick at which the arm brakes;
    - `longest`: largest number of these in succession;
    - `caught_up`: ticks for which the process woke up more than a period too late;
    - `lost`: measurements that did not reach the law.
    """
    arm = ArmSide(job.plan, job.world, job.substeps)
    measurement, command, _, row = job.lengths
    measurements = Mailbox(context.at(job.places.measurements), measurement)
    commands = Mailbox(context.at(job.places.commands), command)
    ring = Ring(context.at(job.places.arm_rows), row, KEPT_ROWS)
    header = measurements.message[:24].view("i8")
    body, torque = measurements.message[24:], commands.message[8:].view("f8")
    sent = commands.message[:8].view("i8")
    wake, missing = arm.arena.view("wake"), arm.arena.view("missing")
    sleeper, period = Sleeper(), round(job.period * SECOND)
    counts = {"ticks": 0, "held": 0, "longest": 0, "caught_up": 0, "lost": 0}
    measurements.clear()
    commands.clear()
    body[:] = arm.measured
    header[:] = -1, now(), 0
    context.ready()
    start = context.started()
    header[1:] = start - period, start - period
    measurements.put(-1)
    applied, without, braked = -1, 0, 0
    reason = cause = "done"
    for k in range(job.ticks + 1):
        due = start + k * period
        sleeper.until(due)
        woke = now()
        number = commands.get()
        requested = sent[0] == STOP
        arrived = number == k and not requested and sent[0] <= due
        if arrived:
            arm.tau[:] = torque
            applied, without = k, 0
        elif not requested:
            without += 1
            if not arm.braking:
                counts["held"] += 1
                counts["longest"] = max(counts["longest"], without)
        if (requested or without > job.patience) and not arm.braking:
            arm.braking = True
            cause = "stop requested" if requested else "no command"
        arm.set(k, arrived)
        measured = arm.measure(k)
        if arm.braking:
            pass  # A braking robot sends no more measurements.
        elif measured:
            body[:] = arm.measured
            header[:] = applied, now(), due
            measurements.put(k)
        else:
            counts["lost"] += 1
        counts["caught_up"] += woke - due > period
        counts["ticks"] += 1
        wake[()], missing[()] = (woke - due) / SECOND, without
        ring.put(arm.row)
        if not arm.move():
            reason = "not finite"
            break
        if arm.braking:
            braked += 1
            reason = cause
            if arm.rests or braked * job.period > BRAKES_FOR:
                break
        elif context.stops:
            reason = "stopped"
            break
    return context.report(reason, counts)


NAP = 20_000
"""Polling interval for an overdue measurement [ns]."""


def run_law(job: LoopJob, context: ProcessContext) -> SideReport:
    """Run the law's loop: wake up, read the newest measurement, send a command, log, sleep.

    The report's counts are

    - `answered`: measurements to which the law sent a command;
    - `skipped`: measurements that a newer one replaced before the law read them;
    - `rolled_back`: commands for which the law discarded its previous command, since the arm had not applied it;
    - `astray`: commands for which the law no longer had its memory after the last applied command (`LawSide`).
    """
    law = LawSide(job.plan, job.period)
    measurement, command, row, _ = job.lengths
    measurements = Mailbox(context.at(job.places.measurements), measurement)
    commands = Mailbox(context.at(job.places.commands), command)
    ring = Ring(context.at(job.places.law_rows), row, KEPT_ROWS)
    sent = measurements.message[:24].view("i8")
    body = measurements.message[24:]
    stamp, torque = commands.message[:8].view("i8"), commands.message[8:]
    status = law.arena.view("status")
    wake, response, took, logged = (law.arena.view(name) for name in ("wake", "response", "took", "logged"))
    sleeper, period = Sleeper(), round(job.period * SECOND)
    counts = {"answered": 0, "skipped": 0, "rolled_back": 0, "astray": 0}
    expected, last = -1, 0
    context.ready()
    start = context.started()
    reason = "done"
    while True:
        due = start + expected * period + job.phase
        sleeper.until(due)
        woke = now()
        number = measurements.get()
        while number < expected:
            looked = now()
            if looked - due > job.patience * period:
                reason = "no measurement"
                break
            if context.stops:
                reason = "stopped"
                break
            sleeper.until(looked + NAP)
            number = measurements.get()
        if number < expected:
            break
        began = now()
        k, applied = number + 1, int(sent[0])
        law.measured[:] = body
        if last > 0 and applied != last - 1:
            counts["rolled_back"] += 1
        if not law.answer(k, applied):
            counts["astray"] += 1
        done = now()
        torque[:] = law.tau
        stamp[0] = STOP if int(status) & job.stop_bit else done
        commands.put(k)
        wake[()], took[()], response[()] = (woke - due) / SECOND, (done - began) / SECOND, (now() - sent[1]) / SECOND
        before = now()
        ring.put(law.row)
        logged[()] = (now() - before) / SECOND
        counts["answered"] += 1
        counts["skipped"] += number - expected
        expected, last = k, k + 1
        if k >= job.ticks:
            break
        law.look_ahead(k + 1)
    return context.report(reason, counts)


if __name__ == "__main__":
    run_process({"arm": run_arm, "law": run_law})
