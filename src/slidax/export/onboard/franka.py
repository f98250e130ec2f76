"""The exported law on a Franka arm through pylibfranka. Runs without slidax."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .pilot import FINISH, STOP, MotionLog, Pilot, load_law, prepare, request_real_time_priority, robot_parser

STATUS = {"finished": 0, "stopped": 3, "reflex": 4, "no robot": 5}
"""Exit codes by the motion's end: finished; stopped by the pilot; stopped by the robot's reflex; no robot found."""


@dataclass(frozen=True)
class FrankaOutcome:
    """Outcome of a motion.

    - `ending`: "finished", "stopped" (by the pilot), "reflex" (by the robot), or "no robot".
    - `why`: the reason in words.
    - `phase`: phase of the reference at the end.
    - `success_rate`: smallest share of commands that arrived, which the robot counts over its last 100 periods.
    """

    ending: str
    why: str
    phase: str
    success_rate: float


def run_franka(
    robot: Any, torques: Any, pilot: Pilot, log: MotionLog | None = None, stop_requests: list[int] | None = None
) -> FrankaOutcome:
    """Move the arm until the motion is over or a check fails.

    - `robot`, `torques`: a `pylibfranka.Robot`, and the class `pylibfranka.Torques`.
    - `pilot`: the law with its reference path and checks; this function calls its `begin`.
    - `log`: log to which each period is added.
    - `stop_requests`: list to which a signal handler may append; the arm comes to rest once it is not empty.
    """
    least = 1.0
    try:
        if not pilot.begin(robot.read_once().q):
            return FrankaOutcome("stopped", pilot.why, pilot.phase, least)
        control = robot.start_torque_control()
    except Exception as error:
        return FrankaOutcome("no robot", str(error), pilot.phase, least)
    finished = False
    try:
        while not finished:
            state, elapsed = control.readOnce()
            if stop_requests:
                pilot.rest()
                stop_requests.clear()
            action = pilot.step(elapsed.to_sec(), state.q, state.dq)
            rate = state.control_command_success_rate
            # The rate counts over 100 periods, and begins at 0.
            if pilot.report.steps > 100:
                least = min(least, rate)
            if action != STOP:
                command = torques(list(pilot.report.tau))
                finished = action == FINISH
                command.motion_finished = finished
                # The command comes before the log: after the period's end it would count as a lost packet.
                control.writeOnce(command)
            if log is not None:
                log.add(pilot, state.q, state.dq, rate)
            if action == STOP:
                robot.stop()
                return FrankaOutcome("stopped", pilot.why, pilot.phase, least)
    except Exception as error:
        return FrankaOutcome("reflex", str(error), pilot.phase, least)
    return FrankaOutcome("finished", pilot.why, pilot.phase, least)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return an exit code from `STATUS`."""
    parser = robot_parser(__doc__, Path(__file__).parent)
    parser.add_argument("--torque-threshold", type=float, default=40.0, help="torque of the collision reflex, N m")
    parser.add_argument("--force-threshold", type=float, default=60.0, help="force of the collision reflex, N")
    options = parser.parse_args(arguments)
    try:
        import pylibfranka
    except ImportError:
        print("pylibfranka is missing: pip install pylibfranka", file=sys.stderr)
        return STATUS["no robot"]
    law = load_law(parser, options.law)
    pilot, log = law.pilot(), MotionLog(law)
    prepare(options, pilot)
    stop_requests: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: stop_requests.append(number))
    realtime = pylibfranka.RealtimeConfig
    try:
        request_real_time_priority(not options.no_realtime)
        robot = pylibfranka.Robot(options.address, realtime.kIgnore if options.no_realtime else realtime.kEnforce)
        robot.set_collision_behavior(
            *[[options.torque_threshold] * 7] * 2,
            *[[options.force_threshold] * 6] * 2,
        )
        if options.load is not None:
            mass, *place = options.load
            robot.set_load(mass, place, [0.0] * 9)
    except Exception as error:
        print(f"no robot: {error}", file=sys.stderr)
        return STATUS["no robot"]
    outcome = run_franka(robot, pylibfranka.Torques, pilot, log, stop_requests)
    if options.log is not None:
        log.write(options.log)
    report = pilot.report
    print(f"{outcome.ending} in phase {outcome.phase}: {outcome.why}")
    print(
        f"{report.steps} periods, {report.missed} late, {report.bridged} bridged, {report.clipped} clipped; "
        f"success rate at least {outcome.success_rate:.2f}"
    )
    return STATUS[outcome.ending]


if __name__ == "__main__":
    sys.exit(main())
