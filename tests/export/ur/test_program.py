import datetime
import inspect
import json
import math
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from benchmarks.targets.franka_chain import python
from slidax import scenarios
from slidax.export.onboard import rehearsal, ur
from slidax.export.onboard.pilot import MotionLog
from slidax.export.robots import export_ur
from tests.export.exported import allow_error, needs_a_compiler, quickly_compiled, shorten


@pytest.fixture(scope="module")
def law(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ur")
    scenario = scenarios.load("ur5e-payload", {"scheme": {"name": "computed_torque"}})
    export_ur(scenario, folder, name="law", golden=False)
    return quickly_compiled(folder / "law")


class Robot:
    """Both interfaces of a simulated arm, which sends its state every 2 ms."""

    def __init__(self, arm):
        self.arm, self.time, self.torques, self.ended, self.kicks = arm, 10.0, [], False, 0
        self.repeats = set()
        self.protective_at = None
        self.nan_from = None
        self.log = None

    @property
    def period(self):
        return len(self.torques)

    def getActualQ(self):
        q = self.arm.measured()[0]
        return [math.nan, *q[1:]] if self.nan_from is not None and self.period >= self.nan_from else q

    def getActualQd(self):
        return self.arm.measured()[1]

    def getTimestamp(self):
        return self.time

    def isProtectiveStopped(self):
        return self.period == self.protective_at

    def isEmergencyStopped(self):
        return False

    def directTorque(self, torque, viscous, coulomb):
        assert len(torque) == len(viscous) == len(coulomb) == 6 and all(map(math.isfinite, torque))
        if self.log is not None and self.period not in self.repeats:
            assert len(self.log.rows) == self.period - sum(item < self.period for item in self.repeats), (
                "not sent first"
            )
        self.torques.append(torque)
        if self.period not in self.repeats:
            self.arm.move(torque)
            self.time += 2e-3
        return True

    def initPeriod(self):
        return datetime.timedelta()

    def waitPeriod(self, arg0):
        assert isinstance(arg0, datetime.timedelta)

    def kickWatchdog(self):
        self.kicks += 1
        return True

    def setWatchdog(self, *_):
        return True

    setPayload = isConnected = setWatchdog

    def stopScript(self):
        self.ended = True


def begun(law):
    pilot = law.pilot()
    shorten(pilot, 1.0)
    allow_error(pilot, 0.3)
    return pilot, Robot(rehearsal.RehearsalArm(law))


@needs_a_compiler
def test_the_ur_program_finishes_its_motion_despite_repeated_robot_states(law):
    pilot, robot = begun(law)
    robot.repeats = {300, 700, 701}
    log = robot.log = MotionLog(law)
    outcome = ur.run_ur(robot, robot, pilot, log)
    assert (outcome.ending, outcome.phase) == ("finished", "rest"), outcome
    assert robot.ended and robot.kicks == robot.period == len(log.rows) + 3
    assert max(abs(value) for value in robot.torques[0]) < 2.0


@needs_a_compiler
def test_faults_end_the_program_and_the_robots_script(law):
    for fault, ending, message in (
        ({"nan_from": 500}, "stopped", "measurement"),
        ({"protective_at": 500}, "robot", "screen"),
        ({"repeats": set(range(500, 600))}, "robot", "no new state"),
    ):
        pilot, robot = begun(law)
        vars(robot).update(fault)
        outcome = ur.run_ur(robot, robot, pilot)
        assert outcome.ending == ending and message in outcome.why and robot.ended and robot.period < 520


@needs_a_compiler
def test_the_robots_script_ends_if_the_motion_cannot_begin(law, monkeypatch):
    pilot, robot = begun(law)
    robot.nan_from = 0
    outcome = ur.run_ur(robot, robot, pilot)
    assert outcome.ending == "stopped" and "the measured posture is not finite" in outcome.why and robot.ended
    pilot, robot = begun(law)
    monkeypatch.setattr(robot, "getActualQ", {}.popitem)
    with pytest.raises(KeyError):
        ur.run_ur(robot, robot, pilot)
    assert robot.ended


@needs_a_compiler
def test_the_robots_script_ends_if_the_payload_or_the_watchdog_cannot_be_set(law, monkeypatch, capsys):
    for refused in ("setPayload", "setWatchdog"):
        robot = Robot(rehearsal.RehearsalArm(law))
        monkeypatch.setattr(robot, refused, lambda *_: math.sqrt(-1.0))
        for module, name in (("rtde_control", "RTDEControlInterface"), ("rtde_receive", "RTDEReceiveInterface")):
            monkeypatch.setitem(sys.modules, module, SimpleNamespace(**{name: lambda *_, robot=robot: robot}))
        arguments = ["robot", "--law", str(law.folder), "--no-realtime", "--load", "1", "0", "0", "0.1"]
        assert ur.main(arguments) == ur.STATUS["no robot"] and robot.ended
        assert capsys.readouterr().err.startswith("no robot: ")


@pytest.mark.skipif(python() is None, reason="no environment .venv-franka with ur_rtde")
@pytest.mark.parametrize(
    ("interface", "module", "name"),
    [(ur.Control, "rtde_control", "RTDEControlInterface"), (ur.Receive, "rtde_receive", "RTDEReceiveInterface")],
)
def test_every_call_matches_the_signatures_of_ur_rtde(interface, module, name):
    used = {key: value for key, value in vars(interface).items() if inspect.isfunction(value) and key[0] != "_"}
    script = f"import json; from {module} import {name} as c\n"
    script += f"print(json.dumps({{k: getattr(c, k).__doc__ for k in {sorted(used)}}}))"
    done = subprocess.run(
        [str(python()), "-c", script], capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": ""}
    )
    message = json.loads(done.stdout)
    for key, function in used.items():
        line = message[key].splitlines()[0]
        ours = inspect.signature(function)
        assert line.rpartition("-> ")[2] == _written(ours.return_annotation), line
        theirs = dict(re.findall(r"(\w+): ([\w.\[\]:]+)", line.partition("(")[2]))
        theirs.pop("self")
        accepted = {each.name: _written(each.annotation) for each in list(ours.parameters.values())[1:]}
        assert accepted == {k: v for k, v in theirs.items() if k in accepted}, line
        # Every other argument has a default.
        assert all(f"{k}: {v} =" in line for k, v in theirs.items() if k not in accepted), line


def _written(annotation):
    return str(annotation)
