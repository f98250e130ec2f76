"""Rehearsal of the motion with a simulation of the scenario's arm in place of the robot. Runs without slidax."""

from __future__ import annotations

import argparse
import csv
import ctypes
import sys
from collections.abc import Sequence
from pathlib import Path

from .pilot import FINISH, GO, STOP, CompiledLaw, MotionLog, Pilot, add_path_options, load_law, prepare


class RehearsalArm:
    """Simulation of the scenario's arm; without gravity if the robot compensates gravity.

    The delays of sensor and drives together delay the measurements, in whole periods.

    - `law`: the exported law, whose C code contains the arm.
    - `q`: initial positions [n], rad or m, at rest; by default the scenario's initial state.
    """

    def __init__(self, law: CompiledLaw, q: Sequence[float] | None = None) -> None:
        self.law = law
        self._Measurement = type(
            "Measurement",
            (ctypes.Structure,),
            {"_fields_": [("t", law.real), ("q", law.vector), ("dq", law.vector)]},
        )
        self.then = (self._Measurement * (law.about["delay"] + 1))()
        law.call("start")(ctypes.byref(self.then))
        if q is not None:
            for moment in self.then:
                moment.q[:] = list(q)
                moment.dq[:] = [0.0] * law.joints
        self.move_by = law.call("move")
        self.move_by.argtypes = [ctypes.c_void_p, law.real, law.vector]

    def measured(self) -> tuple[list[float], list[float]]:
        """Return the delayed measurement that arrives now: positions and velocities [n]."""
        late = self.then[-1]
        return list(late.q), list(late.dq)

    def move(self, tau: Sequence[float]) -> None:
        """Simulate one period with a constant torque [N m or N]."""
        self.move_by(ctypes.addressof(self.then), self.law.period, self.law.vector(*tau))


def rehearse(pilot: Pilot, arm: RehearsalArm, log: MotionLog | None = None, most: float = 600.0) -> int:
    """Run the motion in simulation to its end, for at most `most` seconds; return the last action.

    This action is FINISH, STOP if the pilot stopped the motion, or GO if the motion lasts longer than `most`.

    - `pilot`: the law with its reference path and checks; this function calls its `begin`.
    - `log`: log to which each period is added.
    """
    q, dq = arm.measured()
    if not pilot.begin(q):
        return STOP
    action, elapsed = GO, 0.0
    while action == GO and pilot.report.t < most:
        q, dq = arm.measured()
        action = pilot.step(elapsed, q, dq)
        if log is not None:
            log.add(pilot, q, dq)
        arm.move(list(pilot.report.tau))
        elapsed = pilot.law.period
    return action


def replay(pilot: Pilot, rows: Sequence[dict[str, float]]) -> float:
    """Run the law again on the measurements of a log; return the largest difference of a torque [N m or N].

    - `pilot`: pilot with the options of the logged motion.
    - `rows`: the log, from `read`.
    """
    joints = range(1, pilot.law.joints + 1)
    largest = 0.0
    before = rows[0]["time"]
    # The motion began at the posture that is its first reference.
    pilot.begin([rows[0][f"q_wanted_{k}"] for k in joints])
    for row in rows:
        # Robots count whole milliseconds.
        elapsed = round(1e3 * (row["time"] - before)) / 1e3
        before = row["time"]
        action = pilot.step(elapsed, [row[f"q_{k}"] for k in joints], [row[f"dq_{k}"] for k in joints])
        largest = max(largest, *(abs(pilot.report.tau[k - 1] - row[f"tau_{k}"]) for k in joints))
        if action == STOP:
            break
    return largest


def read(path: str | Path) -> list[dict[str, float]]:
    """Read a log; return for each row its numbers by column name."""
    with open(path, newline="", encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return the exit code: 0 if the motion came to its end, else 3."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--law", type=Path, default=Path(__file__).parent / "law", help="folder of the exported law")
    parser.add_argument("--start", type=float, nargs="+", metavar="RAD", help="initial joint positions of the arm")
    add_path_options(parser)
    options = parser.parse_args(arguments)
    law = load_law(parser, options.law)
    if options.start is not None and len(options.start) != law.joints:
        parser.error(f"--start must be {law.joints} numbers, one for each joint; got {len(options.start)}")
    pilot, log = law.pilot(), MotionLog(law)
    prepare(options, pilot)
    action = rehearse(pilot, RehearsalArm(law, options.start), log)
    if options.log is not None:
        log.write(options.log)
    ending = "finished" if action == FINISH else "stopped"
    print(f"{ending} in phase {pilot.phase} after {pilot.report.t:.3f} s: {pilot.why}")
    largest = max(map(abs, (value for k in range(law.joints) for value in log.column(f"error_{k + 1}"))), default=0.0)
    print(f"largest error {largest:.2e}; {pilot.report.bridged} bridged, {pilot.report.clipped} clipped")
    return 0 if action == FINISH else 3


if __name__ == "__main__":
    sys.exit(main())
