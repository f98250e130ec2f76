"""The exported law on CAN motors in MIT mode, through python-can. Runs without slidax."""

from __future__ import annotations

import argparse
import ctypes
import math
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .pilot import (
    FINISH,
    GO,
    STOP,
    CompiledLaw,
    MotionLog,
    Pilot,
    add_path_options,
    load_law,
    prepare,
    request_real_time_priority,
)

STATUS = {"finished": 0, "stopped": 3, "motor": 4, "no bus": 5}
"""Exit codes by the motion's end: finished; stopped by the pilot; a motor is faulty or silent; no bus found."""

ENABLE, DISABLE = 0xFC, 0xFD
"""Last byte of the frames that enable and disable a motor."""

FAULT = 8
"""Smallest error code of a motor that reports a fault."""

DAMPING, FADE = 1.0, 1.0
"""Damping [N m s/rad] by the motors at the end, and time in which the last torque fades to 0 [s]."""


class Motors:
    """Connection to the arm's motors on one CAN bus.

    - `bus`: an open bus with the methods `send` and `recv` of `can.BusABC`.
    - `message`: the class `can.Message`.
    - `ids`, `replies`: for each motor, the CAN ids of its commands and of its feedback.
    - `signs`, `zeros`: direction of each motor, 1 or -1, and the joint's position at the motor's 0 [rad].
    """

    def __init__(
        self,
        law: CompiledLaw,
        bus: Any,
        message: Any,
        ids: Sequence[int],
        replies: Sequence[int],
        signs: Sequence[float],
        zeros: Sequence[float],
    ) -> None:
        self.law, self.bus, self.message, self.ids, self.replies = law, bus, message, list(ids), list(replies)
        self._Motor = _structure("Motor", law.real, ("position", "speed", "torque", "sign", "zero"))
        self._State = _structure("MotorState", law.real, ("q", "dq", "tau"), ("id", "error"))
        ranges = [(each["position"], each["speed"], each["torque"]) for each in law.about["motors"]]
        self.motors = [self._Motor(*each, s, zero) for each, s, zero in zip(ranges, signs, zeros, strict=True)]
        law.call("can_torque").argtypes = [ctypes.c_void_p, law.real, law.real, ctypes.c_char_p]
        law.call("can_state").argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
        self.errors = [0] * law.joints

    def order(self, order: int) -> None:
        """Send an order, ENABLE or DISABLE, to each motor."""
        for motor in self.ids:
            self._send(motor, bytes([0xFF] * 7 + [order]))

    def command(self, tau: Sequence[float], damping: float = 0.0) -> None:
        """Send a torque [N m] and the damping [N m s/rad] to each motor."""
        frame = ctypes.create_string_buffer(8)
        for at, motor in enumerate(self.motors):
            self.law.call("can_torque")(ctypes.byref(motor), tau[at], damping, frame)
            self._send(self.ids[at], frame.raw)

    def measure(self, until: float, now: Callable[[], float]) -> tuple[list[float], list[float]]:
        """Return positions and velocities of all joints, rad and rad/s; NaN for a motor that does not answer in time.

        - `until`: time of the clock at which to stop waiting [s].
        - `now`: the clock.
        """
        q, dq = [math.nan] * self.law.joints, [math.nan] * self.law.joints
        waiting = set(self.replies)
        while waiting:
            reply = self.bus.recv(max(until - now(), 0.0))
            if reply is None:
                break
            if reply.arbitration_id not in self.replies or len(reply.data) != 8:
                continue
            at = self.replies.index(reply.arbitration_id)
            state = self._State()
            self.law.call("can_state")(ctypes.byref(self.motors[at]), bytes(reply.data), ctypes.byref(state))
            q[at], dq[at], self.errors[at] = state.q, state.dq, state.error
            waiting.discard(reply.arbitration_id)
        return q, dq

    def _send(self, motor: int, data: bytes) -> None:
        self.bus.send(self.message(arbitration_id=motor, data=data, is_extended_id=False))


def _structure(name: str, real: Any, numbers: Sequence[str], counts: Sequence[str] = ()) -> Any:
    fields = [(each, real) for each in numbers] + [(each, ctypes.c_int32) for each in counts]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


@dataclass(frozen=True)
class CanOutcome:
    """Outcome of a motion.

    - `ending`: "finished", "stopped" (by the pilot), or "motor" (a motor is faulty or silent).
    - `why`: the reason in words.
    - `phase`: phase of the reference at the end.
    """

    ending: str
    why: str
    phase: str


def run_can(
    motors: Motors,
    pilot: Pilot,
    log: MotionLog | None = None,
    stop_requests: list[int] | None = None,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> CanOutcome:
    """Move the arm until the motion is over or a check fails; then damp it, fade its torque and disable the motors.

    A motor answers each torque with its state, which the law reads in the next period.

    - `pilot`: the law with its reference path and checks; this function calls its `begin`.
    - `log`: log to which each period is added.
    - `stop_requests`: list to which a signal handler may append; the arm comes to rest once it is not empty.
    - `now`, `sleep`: clock [s], and a function that waits for a time [s].
    """
    period, tau = pilot.law.period, [0.0] * pilot.law.joints
    try:
        motors.order(ENABLE)
        due = now() + max(10 * period, 0.05)
        q, dq = motors.measure(due, now)
        silent = [str(k + 1) for k, value in enumerate(q) if math.isnan(value)]
        if silent:
            return CanOutcome("motor", f"no answer of the motor at joint {', '.join(silent)}", pilot.phase)
        if not pilot.begin(q):
            return CanOutcome("stopped", pilot.why, pilot.phase)
        start = before = now()
        while True:
            if stop_requests:
                pilot.rest()
                stop_requests.clear()
            fault = next((k for k, error in enumerate(motors.errors) if error >= FAULT), None)
            if fault is not None:
                return CanOutcome(
                    "motor", f"fault {motors.errors[fault]:#x} of the motor at joint {fault + 1}", pilot.phase
                )
            moment = now()
            action = pilot.step(moment - before if pilot.report.steps else 0.0, q, dq)
            before = moment
            if action == STOP:
                return CanOutcome("stopped", pilot.why, pilot.phase)
            tau = list(pilot.report.tau)
            motors.command(tau)
            if log is not None:
                log.add(pilot, q, dq)
            if action == FINISH:
                return CanOutcome("finished", pilot.why, pilot.phase)
            assert action == GO
            due = start + pilot.report.steps * period
            q, dq = motors.measure(due, now)
            sleep(max(due - now(), 0.0))
    finally:
        # The motors are disabled even if the bus fails while the torque fades.
        try:
            _fade(motors, tau, period, now)
        finally:
            motors.order(DISABLE)


def _fade(motors: Motors, tau: Sequence[float], period: float, now: Callable[[], float]) -> None:
    """Damp the joints and let the last torque [N m] fade to 0."""
    count = round(FADE / period)
    for k in range(count):
        motors.command([(1.0 - (k + 1) / count) * value for value in tau], DAMPING)
        motors.measure(now() + period, now)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return an exit code from `STATUS`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("channel", help="channel of the CAN bus, such as can0")
    parser.add_argument("--interface", default="socketcan", help="interface of python-can")
    parser.add_argument("--fd", action="store_true", help="use CAN FD")
    parser.add_argument("--law", type=Path, default=Path(__file__).parent / "law", help="folder of the exported law")
    parser.add_argument("--ids", type=_whole, nargs="+", help="motor ids in the law's order; default: 1, 2, ...")
    parser.add_argument("--replies", type=_whole, nargs="+", help="ids of the feedback; default: 0x11, 0x12, ...")
    parser.add_argument("--signs", type=float, nargs="+", help="direction of each motor, 1 or -1; default: 1")
    parser.add_argument("--zeros", type=float, nargs="+", help="joint position at each motor's 0, rad; default: 0")
    parser.add_argument("--no-realtime", action="store_true", help="continue without real-time priority")
    add_path_options(parser)
    options = parser.parse_args(arguments)
    try:
        import can
    except ImportError:
        print("python-can is missing: pip install python-can", file=sys.stderr)
        return STATUS["no bus"]
    law = load_law(parser, options.law)
    joints = range(law.joints)
    values = {
        "ids": options.ids or [k + 1 for k in joints],
        "replies": options.replies or [k + 0x11 for k in joints],
        "signs": options.signs or [1.0] * law.joints,
        "zeros": options.zeros or [0.0] * law.joints,
    }
    for name, each in values.items():
        if len(each) != law.joints:
            parser.error(f"--{name} must be {law.joints} numbers; got {len(each)}")
    if any(abs(value) != 1.0 for value in values["signs"]):
        parser.error("--signs must be 1 or -1 for each motor")
    pilot, log = law.pilot(), MotionLog(law)
    prepare(options, pilot)
    stop_requests: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: stop_requests.append(number))
    try:
        request_real_time_priority(not options.no_realtime)
        bus = can.Bus(channel=options.channel, interface=options.interface, fd=options.fd)
    except Exception as error:
        print(f"no bus: {error}", file=sys.stderr)
        return STATUS["no bus"]
    try:
        outcome = run_can(Motors(law, bus, can.Message, **values), pilot, log, stop_requests)
    finally:
        bus.shutdown()
    if options.log is not None:
        log.write(options.log)
    report = pilot.report
    print(f"{outcome.ending} in phase {outcome.phase}: {outcome.why}")
    print(f"{report.steps} periods, {report.missed} late, {report.bridged} bridged, {report.clipped} clipped")
    return STATUS[outcome.ending]


def _whole(text: str) -> int:
    return int(text, 0)


if __name__ == "__main__":
    sys.exit(main())
