import math
from types import SimpleNamespace

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.export.can_motors import export_can
from slidax.export.onboard.can_motors import DISABLE, ENABLE, Motors, run_can
from slidax.export.onboard.pilot import MotionLog
from slidax.export.onboard.rehearsal import RehearsalArm, rehearse
from tests.export.exported import compiled, needs_a_compiler, quickly_compiled, shorten

CHANGES = {"scheme": {"name": "computed_torque"}, "sensor.delay": 1, "actuator.torque": 40.0}
NAMES = ["DM8009", "DM8009"]
pytestmark = needs_a_compiler


@pytest.fixture(scope="module")
def law(tmp_path_factory):
    folder = tmp_path_factory.mktemp("can")
    export_can(scenarios.load("example-4.1-1khz", CHANGES), folder, motors=NAMES, name="law", golden=False)
    compiled("gcc", folder / "law", "slidax_law_can.c", "-c", "-o", "can.o")
    return quickly_compiled(folder / "law")


def message(arbitration_id, data, is_extended_id=False):
    return SimpleNamespace(arbitration_id=arbitration_id, data=bytes(data), is_extended_id=is_extended_id)


def bits_of(value, most, bits):
    return round((min(max(value, -most), most) + most) / (2 * most) * (2**bits - 1))


class Arm:
    """The scenario's arm behind motors that decode and answer frames by a code of its own; the bus and the clock."""

    def __init__(self, law, signs=(1.0, 1.0), zeros=(0.0, 0.0)):
        self.arm, self.law, self.signs, self.zeros = RehearsalArm(law), law, signs, zeros
        self.t, self.queue, self.frames, self.tau = 0.0, [], [], {}
        self.silent_from = self.fault_at = math.inf
        self.orders = []

    def answer(self, k):
        now = self.arm.then[0]
        raw, speed = self.signs[k] * (now.q[k] - self.zeros[k]), self.signs[k] * now.dq[k]
        q, dq, tau = bits_of(raw, 12.5, 16), bits_of(speed, 45.0, 12), 2048
        error = 0xB if self.t >= self.fault_at else 1
        data = [(k + 1) | error << 4, q >> 8, q & 255, dq >> 4, (dq & 15) << 4 | tau >> 8, tau & 255, 30, 30]
        if self.t < self.silent_from or k == 0:
            self.queue.append(message(0x11 + k, data))

    def send(self, frame):
        k, data = frame.arbitration_id - 1, frame.data
        assert len(data) == 8 and not frame.is_extended_id
        self.answer(k)
        if data[:7] == b"\xff" * 7:
            self.orders.append((k, data[7]))
            return
        gain, torque = (data[3] & 15) << 8 | data[4], (data[6] & 15) << 8 | data[7]
        assert gain == 0
        self.tau[k] = self.signs[k] * (torque * 108.0 / 4095 - 54.0)
        if len(self.tau) == 2:
            self.frames.append([self.tau[0], self.tau[1]])
            self.arm.move(self.frames[-1])
            self.tau, self.t = {}, self.t + self.law.period

    def recv(self, timeout):
        return self.queue.pop(0) if self.queue else None


def run(law, arm, stop_at=None):
    pilot, log = law.pilot(), MotionLog(law)
    shorten(pilot, 0.5)
    motors = Motors(law, arm, message, [1, 2], [0x11, 0x12], arm.signs, arm.zeros)
    requests = []

    def sleep(_):
        if stop_at is not None and arm.t > stop_at:
            requests.append(1)

    return run_can(motors, pilot, log, requests, lambda: arm.t, sleep), log


@pytest.mark.parametrize(("signs", "zeros"), [((1.0, 1.0), (0.0, 0.0)), ((-1.0, 1.0), (0.5, -0.3))])
def test_the_can_arm_tracks_like_the_rehearsal_and_its_torque_fades_out_slowly(law, signs, zeros):
    arm = Arm(law, signs, zeros)
    outcome, log = run(law, arm)
    assert (outcome.ending, outcome.phase) == ("finished", "rest"), outcome
    rehearsed, pilot = MotionLog(law), law.pilot()
    shorten(pilot, 0.5)
    rehearse(pilot, RehearsalArm(law), rehearsed)
    for name in ("error_1", "error_2"):
        # A step of a measured position is 0.4 mrad, of a torque 26 mN m.
        assert max(map(abs, log.column(name))) < max(map(abs, rehearsed.column(name))) + 0.003
    assert arm.orders == [(0, ENABLE), (1, ENABLE), (0, DISABLE), (1, DISABLE)]
    fade = np.abs(np.array(arm.frames[-1000:]))
    assert fade[-1].max() < 0.02 and np.abs(np.diff(fade, axis=0)).max() < 0.1


def test_a_request_to_stop_brings_the_arm_to_rest(law):
    outcome, log = run(law, Arm(law), stop_at=0.8)
    assert outcome.ending == "finished" and log.rows[-1][0] < 3.0


def test_a_motor_without_replies_is_tolerated_briefly_and_then_stops_the_arm(law):
    arm = Arm(law)
    arm.silent_from = 0.4
    outcome, _ = run(law, arm)
    assert outcome.ending == "stopped" and "no good measurement" in outcome.why
    assert arm.orders[-1] == (1, DISABLE)
    arm = Arm(law)
    arm.silent_from = 0.0
    assert run(law, arm)[0].why == "no answer of the motor at joint 2"


def test_a_motor_fault_ends_the_motion_and_names_its_joint(law):
    arm = Arm(law)
    arm.fault_at = 0.3
    outcome, _ = run(law, arm)
    assert (outcome.ending, outcome.why) == ("motor", "fault 0xb of the motor at joint 1") and arm.t < 1.5


@pytest.mark.parametrize("tau", [0.0, 12.3, -53.9, 80.0, -80.0, math.nan])
def test_a_torque_is_encoded_in_a_can_frame_within_half_a_step(law, tau):
    sent = []
    bus = SimpleNamespace(send=sent.append)
    Motors(law, bus, message, [1, 2], [0x11, 0x12], [1.0, -1.0], [0.0, 0.0]).command([tau, tau], 2.5)
    expected = 0.0 if math.isnan(tau) else min(max(tau, -54.0), 54.0)
    for frame, sign in zip(sent, (1.0, -1.0), strict=True):
        data = frame.data
        torque = ((data[6] & 15) << 8 | data[7]) * 108.0 / 4095 - 54.0
        assert sign * torque == pytest.approx(expected, abs=54.0 / 4095 + 1e-9)
        assert (data[5] << 4 | data[6] >> 4) * 5.0 / 4095 == pytest.approx(2.5, abs=5.0 / 4095)


def test_torque_frames_and_motor_replies_pass_through_python_can(law):
    can = pytest.importorskip("can")
    with can.Bus("slidax", interface="virtual") as bus, can.Bus("slidax", interface="virtual") as other:
        motors = Motors(law, bus, can.Message, [1, 2], [0x11, 0x12], [1.0, 1.0], [0.0, 0.0])
        motors.command([10.0, -10.0])
        frames = [other.recv(1.0) for _ in range(2)]
        assert [frame.arbitration_id for frame in frames] == [1, 2]
        arm = Arm(law)
        for k in range(2):
            arm.answer(k)
            reply = arm.queue.pop()
            other.send(can.Message(arbitration_id=reply.arbitration_id, data=reply.data, is_extended_id=False))
        q, dq = motors.measure(1.0, lambda: 0.0)
        assert q == pytest.approx(list(arm.arm.then[0].q), abs=2e-4)
        assert dq == pytest.approx(list(arm.arm.then[0].dq), abs=0.012)
        assert motors.errors == [1, 1]


@pytest.mark.parametrize(
    ("changes", "motors", "words"),
    [
        ({"actuator.torque": 60.0}, NAMES, "60 N m, above the largest torque in a frame of DM8009, 54 N m: lower"),
        ({"sensor.delay": 0}, NAMES, "reads one period later: set the sensor's delay with"),
        ({}, ["DM8009"], "`motors` must have a name for each of the 2 joints; got 1"),
        ({}, ["DM8008", "DM4340"], "unknown motor `DM8008`; "),
    ],
)
def test_an_arm_that_does_not_fit_its_motors_is_refused(tmp_path, changes, motors, words):
    with pytest.raises(DefinitionError, match=words):
        export_can(scenarios.load("example-4.1-1khz", CHANGES | changes), tmp_path, motors=motors, golden=False)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("fails", ["at the first order", "while the torque fades"])
def test_the_motors_are_disabled_even_if_the_bus_fails(law, fails, monkeypatch):
    arm, sends = Arm(law), []
    pilot = law.pilot()
    shorten(pilot, 0.01)
    motors = Motors(law, arm, message, [1, 2], [0x11, 0x12], arm.signs, arm.zeros)
    send = arm.send

    def failing(frame):
        sends.append(frame)
        if len(sends) == 2 if fails == "at the first order" else len(sends) == 2 + 20:
            raise OSError("the bus is off")
        send(frame)

    monkeypatch.setattr(arm, "send", failing)
    # The second motor never answers, so that the torque fades at once.
    arm.silent_from = 0.0
    with pytest.raises(OSError, match="the bus is off"):
        run_can(motors, pilot, None, [], lambda: arm.t, lambda _: None)
    assert arm.orders[-2:] == [(0, DISABLE), (1, DISABLE)]
