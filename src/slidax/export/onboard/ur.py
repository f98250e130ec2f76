"""The exported law on a Universal Robots arm through ur_rtde. Runs without slidax."""

from __future__ import annotations

import datetime
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from .pilot import FINISH, GO, STOP, MotionLog, Pilot, load_law, prepare, request_real_time_priority, robot_parser

STATUS = {"finished": 0, "stopped": 3, "robot": 4, "no robot": 5}
"""Exit codes by the motion's end: finished; stopped by the pilot; stopped by the robot; no robot found."""

FREQUENCY = 500.0
"""Rate of the robot's data and commands [Hz]."""

WATCHDOG = 50.0
"""Rate of commands below which the robot's own script ends [Hz]."""

VISCOUS = (0.9, 0.9, 0.8, 0.9, 0.9, 0.9)
COULOMB = (0.8, 0.8, 0.7, 0.8, 0.8, 0.8)
"""Shares of viscous and Coulomb friction that the robot compensates: its defaults. The law learns the remainder."""


class Control(Protocol):
    """The methods of `rtde_control.RTDEControlInterface` that the program uses."""

    def directTorque(self, torque: list[float], viscous_scale: list[float], coulomb_scale: list[float]) -> bool:
        """Send the joint torques [N m] and the shares of friction to compensate; return False if the robot refuses."""

    def initPeriod(self) -> datetime.timedelta:
        """Begin a period; return its start, for `waitPeriod`."""

    def waitPeriod(self, arg0: datetime.timedelta) -> None:
        """Wait for the end of the period that began at `arg0`."""

    def kickWatchdog(self) -> bool:
        """Report that the loop is alive."""

    def setWatchdog(self, min_frequency: float) -> bool:
        """Set the least rate at which `kickWatchdog` must be called [Hz]."""

    def setPayload(self, arg0: float, arg1: list[float]) -> bool:
        """Set mass [kg] and centre of mass [m] of the payload."""

    def stopScript(self) -> None:
        """End control: the robot holds its posture by itself."""

    def isConnected(self) -> bool:
        """True if the robot answers."""


class Receive(Protocol):
    """The methods of `rtde_receive.RTDEReceiveInterface` that the program uses."""

    def getActualQ(self) -> list[float]:
        """Positions [rad]."""

    def getActualQd(self) -> list[float]:
        """Velocities [rad/s]."""

    def getTimestamp(self) -> float:
        """The robot's time [s]."""

    def isProtectiveStopped(self) -> bool:
        """True after a stop by its safety system."""

    def isEmergencyStopped(self) -> bool:
        """True after an emergency stop."""


@dataclass(frozen=True)
class UrOutcome:
    """Outcome of a motion.

    - `ending`: "finished", "stopped" (by the pilot), "robot" (stopped by the robot), or "no robot".
    - `why`: the reason in words.
    - `phase`: phase of the reference at the end.
    """

    ending: str
    why: str
    phase: str


def run_ur(
    control: Control,
    receive: Receive,
    pilot: Pilot,
    log: MotionLog | None = None,
    stop_requests: list[int] | None = None,
    friction: tuple[Sequence[float], Sequence[float]] = (VISCOUS, COULOMB),
) -> UrOutcome:
    """Move the arm until the motion is over or a check fails; then end the robot's script, also after an exception.

    - `control`, `receive`: the connections to the robot, for commands and for measurements.
    - `pilot`: the law with its reference path and checks; this function calls its `begin`.
    - `log`: log to which each period is added.
    - `stop_requests`: list to which a signal handler may append; the arm comes to rest once it is not empty.
    - `friction`: shares of viscous and of Coulomb friction that the robot compensates, one number per joint each.
    """
    viscous, coulomb = (list(share) for share in friction)
    action, before, waited = GO, None, 0
    try:
        if not pilot.begin(receive.getActualQ()):
            return UrOutcome("stopped", pilot.why, pilot.phase)
        while True:
            begun = control.initPeriod()
            now, fresh = receive.getTimestamp(), False
            if receive.isEmergencyStopped() or receive.isProtectiveStopped():
                return UrOutcome("robot", "the robot is stopped: look at its screen", pilot.phase)
            elapsed = 0.0 if before is None else now - before
            if before is not None and elapsed <= 0.0:
                # The state is the previous one again: keep the last torque until the robot's time goes on.
                waited += 1
                if waited >= pilot.options.lost:
                    return UrOutcome("robot", "the robot sends no new state", pilot.phase)
            else:
                before, waited, fresh = now, 0, True
                if stop_requests:
                    pilot.rest()
                    stop_requests.clear()
                q, dq = receive.getActualQ(), receive.getActualQd()
                action = pilot.step(elapsed, q, dq)
            accepted = action == STOP or control.directTorque(list(pilot.report.tau), viscous, coulomb)
            # The log comes after the torque, so that logging cannot delay the torque.
            if log is not None and fresh:
                log.add(pilot, q, dq)
            if action == STOP:
                return UrOutcome("stopped", pilot.why, pilot.phase)
            if not accepted:
                return UrOutcome("robot", "the robot refused a torque", pilot.phase)
            control.kickWatchdog()
            if action == FINISH:
                return UrOutcome("finished", pilot.why, pilot.phase)
            control.waitPeriod(begun)
    finally:
        control.stopScript()


def _configured(control: Control, load: Sequence[float] | None) -> Control:
    """Set the payload (mass and centre of mass, or None) and the watchdog; if that fails, end the robot's script."""
    try:
        if load is not None:
            mass, *place = load
            control.setPayload(mass, place)
        control.setWatchdog(WATCHDOG)
    except BaseException:
        control.stopScript()
        raise
    return control


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return an exit code from `STATUS`."""
    parser = robot_parser(__doc__, Path(__file__).parent)
    parser.add_argument(
        "--viscous", type=float, nargs=6, default=VISCOUS, help="shares of viscous friction that the robot compensates"
    )
    parser.add_argument(
        "--coulomb", type=float, nargs=6, default=COULOMB, help="shares of Coulomb friction that the robot compensates"
    )
    options = parser.parse_args(arguments)
    try:
        import rtde_control
        import rtde_receive
    except ImportError:
        print("ur_rtde is missing: pip install ur_rtde", file=sys.stderr)
        return STATUS["no robot"]
    law = load_law(parser, options.law)
    pilot, log = law.pilot(), MotionLog(law)
    prepare(options, pilot)
    stop_requests: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: stop_requests.append(number))
    try:
        request_real_time_priority(not options.no_realtime)
        receive = rtde_receive.RTDEReceiveInterface(options.address, FREQUENCY)
        control = _configured(rtde_control.RTDEControlInterface(options.address, FREQUENCY), options.load)
    except Exception as error:
        print(f"no robot: {error}", file=sys.stderr)
        return STATUS["no robot"]
    outcome = run_ur(control, receive, pilot, log, stop_requests, (options.viscous, options.coulomb))
    if options.log is not None:
        log.write(options.log)
    report = pilot.report
    print(f"{outcome.ending} in phase {outcome.phase}: {outcome.why}")
    print(f"{report.steps} periods, {report.missed} late, {report.bridged} bridged, {report.clipped} clipped")
    return STATUS[outcome.ending]


if __name__ == "__main__":
    sys.exit(main())
