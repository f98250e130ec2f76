"""The arm's process in a real-time loop."""

from __future__ import annotations

from .arm import Arm
from .board import Mailbox, Ring
from .clock import SECOND, Sleeper, now
from .job import KEPT_ROWS, STOP, Job, Report
from .process import Stage

BRAKES_FOR = 2.0
"""Longest braking [s]; a real arm's mechanical brakes would hold it by then."""


def run_arm(job: Job, stage: Stage) -> Report:
    """Run the loop: at each tick take its command, measure, publish, and move on.

    A command that arrives after its tick is not applied: the previous torque stands for one more tick. Time does not
    wait: if this process is delayed, it simulates the ticks that passed, as a real arm would have moved on; commands
    that were sent after those ticks count as delayed too. The arm brakes after `patience` ticks without a command, or
    as soon as the law requests a stop, however delayed that command is.
    """
    arm = Arm(job.plan, job.world, job.substeps)
    measurement, command, _, row = job.lengths
    measurements = Mailbox(stage.at(job.places.measurements), measurement)
    commands = Mailbox(stage.at(job.places.commands), command)
    ring = Ring(stage.at(job.places.arm_rows), row, KEPT_ROWS)
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
    stage.ready()
    start = stage.started()
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
            pass  # a braking robot has ended the motion and sends no more measurements
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
        elif stage.stops:
            reason = "stopped"
            break
    return stage.report(reason, counts)
