"""The exported program against a robot that has a fault; run by the Python that has pylibfranka.

    python franka_faults.py FOLDER FAULT

FOLDER has the exported program. FAULT is `none`, `one-nan` (one measurement at 4 s), `nan` (all of them from there on),
`pause` (25 ms at 4 s), or `gravity` (the law adds the weight that the robot carries already). Prints one JSON object.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

WHEN = 4000
"""The period of the fault."""


class Faulty:
    """Control of a robot with a fault."""

    def __init__(self, control: Any, fault: str) -> None:
        self.control, self.fault, self.period = control, fault, 0

    def readOnce(self) -> Any:
        """A state, perhaps with a NaN in it, perhaps late."""
        state, elapsed = self.control.readOnce()
        self.period += 1
        if self.fault == "pause" and self.period == WHEN:
            time.sleep(0.025)
        if self.period == WHEN if self.fault == "one-nan" else self.fault == "nan" and self.period >= WHEN:
            state.q = [math.nan, *list(state.q)[1:]]
        return state, elapsed

    def writeOnce(self, command: Any) -> None:
        """As it is."""
        self.control.writeOnce(command)


class Robot:
    """A robot whose control has a fault."""

    def __init__(self, robot: Any, fault: str) -> None:
        self.robot, self.fault = robot, fault

    def __getattr__(self, name: str) -> Any:
        return getattr(self.robot, name)

    def start_torque_control(self) -> Faulty:
        """Its control."""
        return Faulty(self.robot.start_torque_control(), self.fault)


def main() -> None:
    """One motion with a fault, and where the arm was in the second after it."""
    folder, fault = Path(sys.argv[1]), sys.argv[2]
    sys.path.insert(0, str(folder))
    import program
    import pylibfranka
    from pilot import CompiledLaw, MotionLog, request_real_time_priority

    law = CompiledLaw(folder / "law")
    pilot, log = law.pilot(), MotionLog(law)
    path = pilot.options.path
    path.hold, path.small, path.widen, path.motion = 1.0, 1.0, 2.0, 10.0 if fault == "none" else 1.0
    if fault == "gravity":
        pilot.parameters.nominal_gravity_vector[:] = [0.0, 0.0, -9.81]
    request_real_time_priority(enforce=False)
    robot = pylibfranka.Robot("127.0.0.1", pylibfranka.RealtimeConfig.kIgnore)
    # The robot holds its posture now; what it last did is over.
    robot.automatic_error_recovery()
    outcome = program.run_franka(Robot(robot, fault), pylibfranka.Torques, pilot, log)
    last = list(log.rows[-1][1:8]) if log.rows else [0.0] * 7
    if any(map(math.isnan, last)):
        last = [log.column(f"q_{k}")[WHEN - 2] for k in range(1, 8)]
    moved = 0.0
    for _ in range(100):
        after = robot.read_once().q
        moved = max(moved, *(abs(a - b) for a, b in zip(after, last, strict=True)))
        time.sleep(0.01)
    good = [value for k in range(1, 8) for value in log.column(f"error_{k}")]
    log.write(folder / f"{fault}.csv")
    result = {
        "fault": fault,
        "ending": outcome.ending,
        "reason": pilot.why,
        "outcome": outcome.why,
        "phase": outcome.phase,
        "periods": pilot.report.steps,
        "bridged": pilot.report.bridged,
        "missed": pilot.report.missed,
        "success_rate": outcome.success_rate,
        "largest_error": max(map(abs, good), default=0.0),
        "moved_after": moved,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
