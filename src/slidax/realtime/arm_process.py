"""The process of the arm: `python -m slidax.realtime.arm_process DESCRIPTOR`."""

from __future__ import annotations

from .arm import Arm
from .board import Mailbox, Ring
from .clock import SECOND, Sleeper, now
from .job import KEPT_ROWS, STOP, Job, Report
from .process import Stage, took_part

BRAKES_FOR = 2.0
"""At most [s]; then the arm's own brakes would have it."""


def work(job: Job, stage: Stage) -> Report:
    """The loop: at each tick take the command that is for it, measure, publish, and move on.

    A command that comes late is not taken at all: the torque of the tick before stands for a tick more. Time does not
    wait: where this process itself is late, it makes up for the ticks that went by, as an arm would not have stood
    still either; and a command for them that was sent after their time is late all the same. The arm brakes after
    `patience` ticks without a command, or as soon as the law asks for it, however late that command is.

    - `job`: what is to be done.
    - `stage`: what is shared.
    """
    arm = Arm(job.plan, job.world, job.substeps)
    measurement, command, _, row = job.lengths
    measurements = Mailbox(stage.at(job.places.measurements), measurement)
    commands = Mailbox(stage.at(job.places.commands), command)
    ring = Ring(stage.at(job.places.arm_rows), row, KEPT_ROWS)
    says = measurements.message[:24].view("i8")
    body, torque = measurements.message[24:], commands.message[8:].view("f8")
    sent = commands.message[:8].view("i8")
    wake, missing = arm.arena.view("wake"), arm.arena.view("missing")
    sleeper, period = Sleeper(), round(job.period * SECOND)
    counts = {"ticks": 0, "held": 0, "longest": 0, "caught_up": 0, "lost": 0}
    measurements.clear()
    commands.clear()
    body[:] = arm.measured
    says[:] = -1, now(), 0
    stage.ready()
    start = stage.started()
    says[1:] = start - period, start - period
    measurements.put(-1)
    applied, without, braked = -1, 0, 0
    reason = cause = "done"
    for k in range(job.ticks + 1):
        due = start + k * period
        sleeper.until(due)
        woke = now()
        number = commands.get()
        requested = sent[0] == STOP
        came = number == k and not requested and sent[0] <= due
        if came:
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
        arm.set(k, came)
        goes_out = arm.measure(k)
        if arm.braking:
            pass  # a robot that brakes has ended the motion, and answers no more
        elif goes_out:
            body[:] = arm.measured
            says[:] = applied, now(), due
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


if __name__ == "__main__":
    took_part(work)
