"""The law's process in a real-time loop, and the entry point of both: `python -m MODULE law|arm DESCRIPTOR`."""

from __future__ import annotations

from .arm_process import run_arm
from .board import Mailbox, Ring
from .clock import SECOND, Sleeper, now
from .job import KEPT_ROWS, STOP, Job, Report
from .law import Law
from .process import Stage, run_process

NAP = 20_000
"""Pause between two looks for an overdue measurement [ns]."""


def run_law(job: Job, stage: Stage) -> Report:
    """Run the loop: wake up, take the newest measurement, answer it, log, sleep."""
    law = Law(job.plan, job.period)
    measurement, command, row, _ = job.lengths
    measurements = Mailbox(stage.at(job.places.measurements), measurement)
    commands = Mailbox(stage.at(job.places.commands), command)
    ring = Ring(stage.at(job.places.law_rows), row, KEPT_ROWS)
    sent = measurements.message[:24].view("i8")
    body = measurements.message[24:]
    stamp, torque = commands.message[:8].view("i8"), commands.message[8:]
    status = law.arena.view("status")
    wake, response, took, logged = (law.arena.view(name) for name in ("wake", "response", "took", "logged"))
    sleeper, period = Sleeper(), round(job.period * SECOND)
    counts = {"answered": 0, "skipped": 0, "rolled_back": 0, "astray": 0}
    expected, last = -1, 0
    stage.ready()
    start = stage.started()
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
            if stage.stops:
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
    return stage.report(reason, counts)


if __name__ == "__main__":
    run_process({"arm": run_arm, "law": run_law})
