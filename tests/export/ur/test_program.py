"""The program for ur_rtde: against an arm of ours, and its calls against the wheel's own signatures."""

from __future__ import annotations

import datetime
import inspect
import json
import math
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks.targets.franka_chain import python
from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.export.onboard import pilot as onboard
from slidax.export.onboard import rehearsal, ur
from slidax.export.onboard.pilot import MotionLog
from slidax.export.robots import export_ur
from tests.export.exported import needs_a_compiler


@pytest.fixture(scope="module")
def law(tmp_path_factory: pytest.TempPathFactory) -> onboard.CompiledLaw:
    folder = tmp_path_factory.mktemp("ur")
    scenario = scenarios.load("ur5e-payload", {"scheme": {"name": "computed_torque"}})
    export_ur(scenario, folder, name="law", golden=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")
        return onboard.CompiledLaw(folder / "law")


class Robot:
    """Both interfaces of an arm of ours, which tells its state every 2 ms."""

    def __init__(self, arm: rehearsal.RehearsalArm) -> None:
        self.arm, self.time, self.torques, self.ended, self.kicks = arm, 10.0, [], False, 0
        self.repeats: set[int] = set()
        self.protective_at: int | None = None
        self.nan_from: int | None = None
        self.log: MotionLog | None = None

    @property
    def period(self) -> int:
        return len(self.torques)

    def getActualQ(self) -> list[float]:
        q = self.arm.measured()[0]
        return [math.nan, *q[1:]] if self.nan_from is not None and self.period >= self.nan_from else q

    def getActualQd(self) -> list[float]:
        return self.arm.measured()[1]

    def getTimestamp(self) -> float:
        return self.time

    def isProtectiveStopped(self) -> bool:
        return self.period == self.protective_at

    def isEmergencyStopped(self) -> bool:
        return False

    def directTorque(self, torque: list[float], viscous: list[float], coulomb: list[float]) -> bool:
        assert len(torque) == len(viscous) == len(coulomb) == 6 and all(map(math.isfinite, torque))
        if self.log is not None and self.period not in self.repeats:
            assert len(self.log.rows) == self.period - sum(one < self.period for one in self.repeats), "not sent first"
        self.torques.append(torque)
        if self.period not in self.repeats:
            self.arm.move(torque)
            self.time += 2e-3
        return True

    def initPeriod(self) -> datetime.timedelta:
        return datetime.timedelta()

    def waitPeriod(self, arg0: datetime.timedelta) -> None:
        assert isinstance(arg0, datetime.timedelta)

    def kickWatchdog(self) -> bool:
        self.kicks += 1
        return True

    def setWatchdog(self, min_frequency: float) -> bool:
        return True

    def setPayload(self, arg0: float, arg1: list[float]) -> bool:
        return True

    def isConnected(self) -> bool:
        return True

    def stopScript(self) -> None:
        self.ended = True


def begun(law: onboard.CompiledLaw) -> tuple[onboard.Pilot, Robot]:
    pilot = law.pilot()
    path = pilot.options.path
    path.hold = path.small = path.widen = path.motion = 1.0
    for name in ("error_hold", "error_small", "error_full"):
        # Textbook computed torque has no estimator for the friction.
        getattr(pilot.options, name)[:] = [0.3] * 6
    return pilot, Robot(rehearsal.RehearsalArm(law))


@needs_a_compiler
def test_it_moves_the_arm_to_the_end_also_where_a_state_comes_twice(law: onboard.CompiledLaw) -> None:
    pilot, robot = begun(law)
    robot.repeats = {300, 700, 701}
    log = robot.log = MotionLog(law)
    outcome = ur.run_ur(robot, robot, pilot, log)
    assert (outcome.ending, outcome.phase) == ("finished", "rest"), outcome
    assert robot.ended and robot.kicks == robot.period == len(log.rows) + 3
    assert max(abs(value) for value in robot.torques[0]) < 2.0


@needs_a_compiler
def test_faults_end_it_and_always_end_the_robots_script(law: onboard.CompiledLaw) -> None:
    for fault, ending, said in (
        ({"nan_from": 500}, "stopped", "measurement"),
        ({"protective_at": 500}, "robot", "screen"),
        ({"repeats": set(range(500, 600))}, "robot", "no new state"),
    ):
        pilot, robot = begun(law)
        vars(robot).update(fault)
        outcome = ur.run_ur(robot, robot, pilot)
        assert outcome.ending == ending and said in outcome.why and robot.ended
        assert robot.period < 520


@pytest.mark.skipif(python() is None, reason="no environment .venv-franka with ur_rtde")
@pytest.mark.parametrize(
    ("interface", "module", "name"),
    [
        (ur.Control, "rtde_control", "RTDEControlInterface"),
        (ur.Receive, "rtde_receive", "RTDEReceiveInterface"),
    ],
)
def test_every_call_is_one_that_the_wheel_takes(interface: type, module: str, name: str) -> None:
    used = {key: value for key, value in vars(interface).items() if inspect.isfunction(value) and key[0] != "_"}
    script = f"import json; from {module} import {name} as c\n"
    script += f"print(json.dumps({{k: getattr(c, k).__doc__ for k in {sorted(used)}}}))"
    done = subprocess.run(
        [str(python()), "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": ""},
    )
    said = json.loads(done.stdout)
    for key, function in used.items():
        line = said[key].splitlines()[0]
        ours = inspect.signature(function)
        assert line.rpartition("-> ")[2] == _written(ours.return_annotation), line
        theirs = dict(re.findall(r"(\w+): ([\w.\[\]:]+)", line.partition("(")[2]))
        theirs.pop("self")
        given = {each.name: _written(each.annotation) for each in list(ours.parameters.values())[1:]}
        assert given == {k: v for k, v in theirs.items() if k in given}, line
        # What is not given has a default.
        assert all(f"{k}: {v} =" in line for k, v in theirs.items() if k not in given), line


def _written(annotation: Any) -> str:
    return str(annotation)


def test_what_is_no_such_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="6 joints"):
        export_ur(scenarios.load("example-4.1-1khz"), tmp_path)
    with pytest.raises(DefinitionError, match=r"--set simulation\.period=2e-3"):
        export_ur(scenarios.load("ur5e-payload", {"simulation.period": 1e-3, "scheme": {"name": "pid"}}), tmp_path)
