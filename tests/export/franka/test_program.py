import csv
import math
import os
import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.arms import Articulated
from slidax.export.onboard import franka, rehearsal
from slidax.export.onboard import pilot as onboard
from slidax.export.onboard.pilot import MotionLog
from slidax.export.robots import export_franka, weight_by_robot
from tests.export.exported import needs_a_compiler, needs_cmake, quickly_compiled, shorten

pytestmark = needs_a_compiler
STUBS = Path(__file__).parent / "stubs"
SHORT = ["--hold", "1", "--small", "1", "--widen", "1", "--motion", "1"]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("franka")
    scenario = scenarios.load("panda-payload", {"scheme": {"name": "computed_torque"}, "sensor": {"delay": 1.0}})
    export_franka(scenario, folder, name="law", golden=False)
    return folder


@pytest.fixture(scope="module")
def built(exported):
    build = exported / "build"
    checked = "-Werror -fsanitize=address,undefined -fno-sanitize-recover=all"
    flags = [f"-DCMAKE_C_FLAGS={checked}", f"-DCMAKE_CXX_FLAGS={checked}", "-DCMAKE_BUILD_TYPE=Debug"]
    subprocess.run(
        ["cmake", "-S", exported, "-B", build, f"-DFranka_DIR={STUBS}", *flags], check=True, capture_output=True
    )
    subprocess.run(["cmake", "--build", build], check=True, capture_output=True)
    return build / "main"


@pytest.fixture(scope="module")
def law(exported):
    return quickly_compiled(exported / "law")


def ran(program, *arguments, fault=""):
    environment = {**os.environ, "FAULT": fault}
    return subprocess.run([program, *arguments], env=environment, capture_output=True, text=True, check=False)


@needs_cmake
def test_the_franka_program_moves_the_arm_from_its_posture_through_the_whole_motion(built, tmp_path):
    result = ran(built, "robot", *SHORT, "--no-realtime", "--log", str(tmp_path / "log.csv"))
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stdout.startswith("finished in phase rest: nothing is wrong")
    with open(tmp_path / "log.csv", newline="", encoding="utf-8") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    tau = np.array([[row[f"tau_{k}"] for k in range(1, 8)] for row in rows])
    # The robot compensates gravity: commands begin near zero and never step by more than the robot allows.
    assert np.abs(tau[0]).max() < 0.5 and np.abs(np.diff(tau, axis=0)).max() <= 1.0
    phases = [row["phase"] for row in rows]
    assert phases == sorted(phases) and set(phases) == {0, 1, 2, 3, 4, 5}
    assert min(row["margin"] for row in rows) > 0.0


@needs_cmake
@pytest.mark.parametrize(
    ("fault", "code", "message"),
    [
        *(("one-nan", 0, "1 bridged"), ("nan", 3, "no good measurement for too long")),
        *(("gap", 3, "too many periods without a sample"), ("push", 3, "the error is too large (joint 4)")),
    ],
)
def test_a_fault_ends_the_franka_program_with_the_documented_exit_code(built, fault, code, message):
    result = ran(built, "robot", *SHORT, "--no-realtime", fault=fault)
    assert (result.returncode, message in result.stdout) == (code, True), result.stdout + result.stderr


@pytest.mark.full
@needs_cmake
def test_invalid_arguments_of_the_franka_program_are_refused_with_exit_code_2(built):
    for arguments, message in (
        ([], "the robot's address is missing"),
        (["robot", "--hold"], "--hold needs a value"),
        (["robot", "--hold", "x"], "--hold needs a number; got x"),
        (["robot", "--bold", "1"], "unknown option --bold"),
    ):
        result = ran(built, *arguments)
        assert result.returncode == 2 and result.stderr.strip().endswith(message), result.stderr
    nobody = ran(built, "nowhere")
    assert nobody.returncode == 5 and "no answer from nowhere" in nobody.stderr
    assert ran(built, "robot", "--hold", "nan").returncode == 3


class Control:
    """Torque control as in `pylibfranka`: the scenario's arm, whose gravity the robot compensates."""

    def __init__(self, arm, breaks):
        self.arm, self.breaks, self.periods = arm, breaks, 0
        self.last = [0.0] * 7

    def readOnce(self):
        self.periods += 1
        if self.periods == self.breaks:
            raise RuntimeError("communication_constraints_violation")
        q, dq = self.arm.measured()
        return _Any(q=q, dq=dq, control_command_success_rate=1.0), _Any(to_sec=lambda: 1e-3 * (self.periods > 1))

    def writeOnce(self, command):
        assert max(abs(a - b) for a, b in zip(command.tau_J, self.last, strict=True)) <= 1.0
        self.last = list(command.tau_J)
        self.arm.move(self.last)


class Robot:
    def __init__(self, arm, breaks=None):
        self.control, self.stopped = Control(arm, breaks), False

    def read_once(self):
        return self.control.readOnce()[0]

    def start_torque_control(self):
        self.control.periods = 0
        return self.control

    def stop(self):
        self.stopped = True


class _Any:
    def __init__(self, **values):
        self.__dict__.update(values)


class Torques:
    def __init__(self, tau):
        self.tau_J, self.motion_finished = tau, False


def short(law):
    pilot = law.pilot()
    shorten(pilot, 1.0)
    return pilot


def test_the_python_franka_program_finishes_and_its_log_replays_bit_for_bit(law):
    pilot, log = short(law), MotionLog(law)
    outcome = franka.run_franka(Robot(rehearsal.RehearsalArm(law)), Torques, pilot, log)
    assert (outcome.ending, outcome.phase, outcome.success_rate) == ("finished", "rest", 1.0)
    rows = [dict(zip(log.columns, row, strict=True)) for row in log.rows]
    assert rehearsal.replay(short(law), rows) == 0.0


def test_a_reflex_is_reported_and_a_requested_stop_ends_at_rest(law):
    broken = franka.run_franka(Robot(rehearsal.RehearsalArm(law), breaks=300), Torques, short(law))
    assert (broken.ending, broken.why) == ("reflex", "communication_constraints_violation")
    ended = franka.run_franka(Robot(rehearsal.RehearsalArm(law)), Torques, pilot := short(law), stop_requests=[2])
    assert (ended.ending, ended.why) == ("finished", "a stop was requested") and pilot.report.t < 1.6


def test_gravity_compensated_twice_stops_the_program_before_the_motion_begins(law):
    pilot = short(law)
    pilot.parameters.nominal_gravity_vector[:] = [0.0, 0.0, -9.81]
    robot = Robot(rehearsal.RehearsalArm(law))
    outcome = franka.run_franka(robot, Torques, pilot)
    assert outcome.ending == "stopped" and "compensates gravity" in outcome.why and outcome.phase == "hold"
    assert robot.stopped and pilot.report.steps < 40


def test_a_motion_does_not_begin_at_a_posture_out_of_range(law):
    for q in ([0.0] * 7, [math.nan] * 7):
        pilot = law.pilot()
        assert not pilot.begin(q) and pilot.step(0.0, q, [0.0] * 7) == onboard.STOP
        assert list(pilot.report.tau) == [0.0] * 7


def test_torque_limits_are_reduced_by_gravity_if_the_robot_compensates_it():
    scenario = scenarios.load("panda-payload", {"scheme": {"name": "computed_torque"}})
    without = weight_by_robot(scenario)
    (arm,), (light,) = (
        [leaf for leaf in jax.tree.leaves(each.controller, is_leaf=_arm) if _arm(leaf)] for each in (scenario, without)
    )
    q = jax.vmap(lambda t: scenario.trajectory.reference(t).q)(jnp.linspace(0.0, 8.0, 50))
    weight = np.abs(jax.vmap(arm.gravity)(q)).max(axis=0)
    assert weight.max() > 15.0
    assert np.abs(jax.vmap(light.gravity)(q)).max() == np.abs(jax.vmap(without.plant.robot.gravity)(q)).max() == 0.0
    # The export evaluates the gravity torque at other times.
    off = np.asarray(without.plant.actuator.limits.torque) + weight - np.asarray(arm.limits.torque)
    assert (off <= 0.05).all() and (off >= -0.2).all()


def _arm(node):
    return isinstance(node, Articulated)
