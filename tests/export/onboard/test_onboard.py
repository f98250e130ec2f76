import ctypes
import math
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.export.c_project import export_c
from slidax.export.onboard import pilot as onboard
from slidax.export.onboard import rehearsal
from slidax.export.onboard.rehearsal import RehearsalArm, rehearse
from slidax.export.robots import SOURCES, RobotLimits, write_onboard
from tests.export.exported import STRICT, allow_error, compiled, needs_a_compiler, quickly_compiled, shorten

SCENARIO = scenarios.load("example-4.1-1khz", {"scheme": {"name": "computed_torque"}})
pytestmark = needs_a_compiler
PARTS = ("q", "dq", "ddq")


@pytest.fixture(scope="module")
def law(tmp_path_factory):
    folder = tmp_path_factory.mktemp("onboard")
    project = export_c(SCENARIO, folder / "law", name="law", golden=False)
    write_onboard(project, RobotLimits.of(SCENARIO, project), folder)
    for part in SOURCES:
        compiled("gcc", folder / "law", f"slidax_law_{part}.c", "-c", "-o", f"{part}.o", *STRICT)
    return onboard.CompiledLaw(folder / "law")


@pytest.mark.parametrize("rest_at", [None, 0.4, 1.5, 3.0, 4.0])
def test_the_path_is_smooth_to_rest_whenever_a_stop_is_requested(law, rest_at):
    pilot = law.pilot()
    path = pilot.options.path
    path.hold, path.small, path.widen, path.motion, path.speed = 0.5, 1.0, 1.0, 1.0, 1.0
    start = [0.4, -0.3]
    h = 1e-3
    rows = {part: [] for part in PARTS}
    pilot.begin(start)
    pilot.options.speed[:] = [1e3] * 2
    allow_error(pilot, 1e3)
    # The arm stands still all the time, which the law cannot know.
    pilot.options.limited = pilot.options.outside = 10**6
    for k in range(12000):
        action = pilot.step(h if k else 0.0, start, [0.0, 0.0])
        for part in PARTS:
            rows[part].append(list(getattr(pilot.reference, part)))
        if rest_at is not None and abs(k * h - rest_at) < h / 2:
            pilot.rest()
        if action != onboard.GO:
            break
    assert action == onboard.FINISH
    q, dq, ddq = (np.array(rows[part]) for part in PARTS)
    assert q[0].tolist() == start and not dq[0].any() and not ddq[0].any()
    assert not dq[-1].any() and not ddq[-1].any()
    # Central differences have an error that is proportional to the third derivative.
    assert np.abs((q[2:] - q[:-2]) / (2 * h) - dq[1:-1]).max() < 1e-4
    jumps = np.abs(np.diff(dq, axis=0)) - h * np.abs(ddq[1:])
    assert jumps.max() < 1e-3
    if rest_at is None:
        # After the start-up phases the path is the scenario's own motion.
        moved = next(k for k in range(len(q)) if k * h > path.hold + 3.0)
        wanted = np.array(
            [np.asarray(SCENARIO.trajectory.reference(jnp.asarray(s)).q) for s in np.linspace(2.0, 3.0, 6)]
        )
        nearest = [np.abs(q[moved:] - item).max(axis=1).min() for item in wanted]
        assert max(nearest) < 2e-3


def test_the_predicted_next_reference_equals_the_reference_one_period_later(law):
    pilot = law.pilot()
    pilot.begin([0.4, -0.3])
    pilot.options.path.hold = 0.0
    later = None
    for k in range(400):
        pilot.step(1e-3 if k else 0.0, list(pilot.reference.q_next) if k else [0.4, -0.3], [0.0, 0.0])
        if later is not None:
            assert np.abs(np.array(pilot.reference.q) - later).max() < 1e-12
        later = np.array(pilot.reference.q_next)


def following(law):
    pilot = law.pilot()
    pilot.options.follows = True
    pilot.options.path.hold = 0.0
    pilot.options.lower[:], pilot.options.upper[:], pilot.options.speed[:] = [-2.0] * 2, [2.0] * 2, [1.5] * 2
    allow_error(pilot, 0.5)
    return pilot


@pytest.mark.parametrize("parts", ["q", "dq", "ddq"])
def test_a_trajectory_passes_its_points_and_is_replaced_smoothly(law, parts):
    pilot, arm = following(law), RehearsalArm(law, [0.1, 0.2])
    pilot.begin([0.1, 0.2])
    times = [0.5, 1.0, 1.5]
    q = [[0.3, 0.1], [0.4, 0.1], [0.3, 0.0]]
    dq = [[0.3, 0.0], [0.1, -0.1], [0.0, 0.0]]
    ddq = [[0.0, 0.0]] * 3
    pilot.step(0.0, *arm.measured())
    assert pilot.take(times, q, None if parts == "q" else dq, ddq if parts == "ddq" else None) == ""
    before = np.array([0.1, 0.2])
    for k in range(1, 1200):
        arm.move(list(pilot.report.tau))
        assert pilot.step(1e-3, *arm.measured()) == onboard.GO, pilot.why
        now = np.array(pilot.reference.q)
        assert np.abs(now - before).max() < 2e-3
        before = now
        for t, point in zip(times, q, strict=True):
            if k == round(1e3 * t):
                assert np.abs(now - point).max() < 1e-9
        if k == 800:
            speed = np.array(pilot.reference.dq)
            assert pilot.take([1.0], [[0.0, 0.0]], [[0.0, 0.0]]) == ""
            times, q = [], []
        if k == 801:
            assert np.abs(np.array(pilot.reference.dq) - speed).max() < 0.02


@pytest.mark.parametrize(
    ("times", "q", "dq", "message"),
    [
        ([], [], None, "no points"),
        ([0.5], [[math.nan, 0.0]], None, "NaN"),
        ([0.0], [[0.1, 0.2]], None, "times must be positive and increasing"),
        ([0.5, 0.5], [[0.1, 0.2]] * 2, None, "times must be positive and increasing"),
        ([1.0], [[0.2, 0.2]], [[0.5, 0.0]], "at rest"),
        ([5.0], [[2.5, 0.2]], None, "position range"),
        ([0.1], [[0.5, 0.2]], None, "speed limits"),
        ([1.0 + k for k in range(256)], [[0.1, 0.2]] * 256, None, "too many"),
    ],
)
def test_an_invalid_trajectory_is_refused_with_a_reason(law, times, q, dq, message):
    pilot = following(law)
    pilot.begin([0.1, 0.2])
    pilot.step(0.0, [0.1, 0.2], [0.0, 0.0])
    assert message in pilot.take(times, q, dq)
    pilot.step(1e-3, [0.1, 0.2], [0.0, 0.0])
    assert list(pilot.reference.q) == [0.1, 0.2]


def test_a_requested_stop_brings_the_arm_to_rest_during_a_trajectory(law):
    pilot, arm = following(law), RehearsalArm(law, [0.1, 0.2])
    pilot.begin([0.1, 0.2])
    pilot.step(0.0, *arm.measured())
    assert pilot.take([2.0], [[1.0, 0.2]], [[0.0, 0.0]]) == ""
    for k in range(3000):
        arm.move(list(pilot.report.tau))
        action = pilot.step(1e-3, *arm.measured())
        if k == 900:
            pilot.rest()
        if action != onboard.GO:
            break
    assert (action, pilot.phase) == (onboard.FINISH, "rest") and 1900 <= k <= 1902
    assert abs(pilot.reference.q[0]) < 1.0 and pilot.reference.dq[0] == 0.0


def test_invalid_measurements_are_bridged_for_some_periods_and_then_stop_the_arm(law):
    pilot, arm = law.pilot(), RehearsalArm(law)
    pilot.begin(arm.measured()[0])
    action, bridged, held = onboard.GO, 0, None
    for k in range(200):
        q, dq = arm.measured()
        if k in (50, 51) or k >= 100:
            q = [math.nan, q[1]]
            held = held or list(pilot.report.tau)
            bridged += 1
        else:
            held = None
        action = pilot.step(1e-3 if k else 0.0, q, dq)
        assert all(map(math.isfinite, pilot.report.tau))
        if held is not None:
            assert list(pilot.report.tau) == held
        if action == onboard.STOP:
            break
        arm.move(list(pilot.report.tau))
    assert (action, k, pilot.report.bridged) == (onboard.STOP, 100 + pilot.options.held, bridged)
    assert "measurement" in pilot.why
    assert law.conditions(pilot.report.status) == ["MEASUREMENT_NOT_FINITE", "STOP_REQUESTED"]
    # The pilot stays stopped when measurements are valid again.
    assert pilot.step(1e-3, *arm.measured()) == onboard.STOP


def test_torque_at_its_limits_for_too_long_brings_the_arm_to_rest(law):
    pilot, arm = law.pilot(), RehearsalArm(law)
    pilot.parameters.limits_torque[:] = [1e-3] * 2
    allow_error(pilot, 1e3)
    assert rehearse(pilot, arm) == onboard.FINISH
    assert pilot.why == "the torque has been at its limits for too long" and pilot.report.t < 2.0


def test_the_robots_torque_and_rate_limits_hold_even_if_the_laws_limits_differ(law):
    pilot, arm = law.pilot(), RehearsalArm(law)
    pilot.options.torque[:], pilot.options.rate[:] = [20.0] * 2, [500.0] * 2
    pilot.options.free = False
    pilot.begin(arm.measured()[0])
    last = np.zeros(2)
    for k in range(300):
        pilot.step(1e-3 if k else 0.0, *arm.measured())
        now = np.array(pilot.report.tau)
        assert np.abs(now - last).max() <= 0.5 + 1e-12 and np.abs(now).max() <= 20.0
        last = now
    assert pilot.report.clipped > 0


def test_c_structures_have_the_same_size_in_python_and_c(law, tmp_path):
    names = ("options", "report", "reference", "command", "parameters", "trajectory", "admission")
    lines = "".join(f'    printf("%zu\\n", sizeof(slidax_law_{name}));\n' for name in names)
    text = f'#include "slidax_law_admit.h"\n#include <stdio.h>\nint main(void) {{\n{lines}    return 0;\n}}\n'
    (tmp_path / "sizes.c").write_text(text)
    subprocess.run(["gcc", f"-I{law.folder}", tmp_path / "sizes.c", "-o", tmp_path / "sizes"], check=True)
    result = subprocess.run([tmp_path / "sizes"], check=True, capture_output=True, text=True).stdout.split()
    assert [ctypes.sizeof(getattr(law, name.capitalize())) for name in names] == list(map(int, result))


def test_the_pilot_in_single_precision_finishes_its_motion(tmp_path):
    project = export_c(SCENARIO, tmp_path / "law", name="law", single=True, golden=False)
    write_onboard(project, RobotLimits.of(SCENARIO, project), tmp_path)
    for part in SOURCES:
        compiled("gcc", tmp_path / "law", f"slidax_law_{part}.c", "-c", "-o", f"{part}.o", "-Wdouble-promotion")
    law = quickly_compiled(tmp_path / "law")
    pilot = law.pilot()
    shorten(pilot, 1.0)
    allow_error(pilot, 0.5)
    assert rehearse(pilot, RehearsalArm(law)) == onboard.FINISH, pilot.why


def test_a_missing_compiler_or_law_ends_the_program_with_an_error_that_names_it(law, tmp_path, capsys, monkeypatch):
    with pytest.raises(SystemExit) as none:
        rehearsal.main(["--law", str(tmp_path)])
    assert none.value.code == 2 and capsys.readouterr().err.splitlines()[-1].endswith("law.json")
    (law.folder / "libslidax_law.so").unlink()
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(SystemExit) as no_compiler:
        rehearsal.main(["--law", str(law.folder)])
    assert no_compiler.value.code == 2 and "install gcc, or set CC" in capsys.readouterr().err


def at_rest(law):
    pilot = following(law)
    pilot.begin([0.1, 0.2])
    pilot.step(0.0, [0.1, 0.2], [0.0, 0.0])
    pilot.options.speed[:] = [1e3] * 2
    return pilot


def quintic(law, pilot, goal, seconds):
    goals = [list(pilot.reference.q), goal]
    return pilot.trajectory([0.0, seconds], goals, [[0.0] * 2] * 2, [[0.0] * 2] * 2)


def needed(law, pilot, q, dq, ddq):
    tau = law.vector()
    law.call("nominal_torque")(pilot.parameters, *(law.vector(*each) for each in (q, dq, ddq)), tau)
    return np.array(tau)


def test_the_nominal_torque_in_c_agrees_with_the_nominal_arm_in_python(law):
    pilot, arm = law.pilot(), SCENARIO.controller.nominal
    q, dq, ddq = [0.3, -0.7], [0.5, 1.1], [2.0, -3.0]
    expected = (
        arm.mass(jnp.array(q)) @ jnp.array(ddq) + arm.bias(jnp.array(q), jnp.array(dq)) + arm.friction(jnp.array(dq))
    )
    assert needed(law, pilot, q, dq, ddq) == pytest.approx(np.asarray(expected), rel=1e-12)


def test_a_trajectory_that_needs_too_much_torque_is_refused_with_joint_time_and_amount(law):
    pilot = at_rest(law)
    pilot.options.torque[:] = [1e6, 60.0]
    admission = pilot.admit(quintic(law, pilot, [1.0, 1.2], 0.3))
    why = admission.violation
    assert admission.slowdown == 0.0 and law.text("taken", why.verdict) == "it needs more torque than a trajectory may"
    assert why.joint == 2 and why.limit == pytest.approx(0.9 * 60.0) and why.value > why.limit and 0.0 <= why.t < 0.3


def test_a_trajectory_is_slowed_just_enough_to_keep_the_torque_limit(law):
    pilot = at_rest(law)
    pilot.options.torque[:] = [150.0, 60.0]
    pilot.options.path.ramp = 1e3
    fast = quintic(law, pilot, [1.0, 1.2], 0.3)
    slowdown = pilot.admit(fast, 20.0).slowdown
    assert 1.0 < slowdown < 20.0 and fast.points[1].t == pytest.approx(0.3 * slowdown)
    start, way = np.array([0.1, 0.2]), np.array([0.9, 1.0])

    def share(seconds):
        x = np.linspace(0.0, 1.0, 400)[:, None]
        q = start + way * x**3 * (10 - 15 * x + 6 * x**2)
        dq = way * 30 * x**2 * (1 - x) ** 2 / seconds
        ddq = way * 60 * x * (1 - x) * (1 - 2 * x) / seconds**2
        tau = [needed(law, pilot, *row) for row in zip(q, dq, ddq, strict=True)]
        return (np.abs(tau) / np.array(pilot.options.torque)).max()

    assert 0.88 < share(0.3 * slowdown) < 0.902 < share(0.3 * slowdown / 1.02)


def test_stops_during_an_admitted_trajectory_keep_the_torque_limit(law):
    for ramp in (1.0, 0.1):
        pilot = at_rest(law)
        pilot.options.torque[:] = [150.0, 60.0]
        pilot.options.path.ramp = ramp
        motion = quintic(law, pilot, [1.0, 1.2], 0.3)
        assert pilot.admit(motion, 20.0).slowdown > 1.0
        times, q = [0.0, motion.points[1].t], [[0.1, 0.2], [1.0, 1.2]]
        for begins in np.linspace(0.1, 0.9, 5) * motion.points[1].t:
            pilot = at_rest(law)
            pilot.options.path.ramp = ramp
            assert pilot.take(times, q, [[0.0] * 2] * 2, [[0.0] * 2] * 2) == ""
            most, halted = 0.0, False
            for k in range(1, int(1e3 * (begins + ramp)) + 10):
                if k * 1e-3 >= begins and not halted:
                    pilot.halt()
                    halted = True
                pilot.options.limited = pilot.options.outside = 10**6
                allow_error(pilot, 1e3)
                pilot.step(1e-3, [0.1, 0.2], [0.0, 0.0])
                wanted = pilot.reference
                most = max(most, np.abs(needed(law, pilot, wanted.q, wanted.dq, wanted.ddq) / [150.0, 60.0]).max())
            assert 0.2 < most < 0.903 and list(pilot.reference.dq) == [0.0, 0.0]


def test_a_point_at_time_zero_must_be_where_the_arm_is(law):
    pilot = at_rest(law)
    pilot.options.error_small[:] = [0.05] * 2
    assert pilot.take([0.0, 1.0], [[0.14, 0.2], [0.5, 0.2]]) == ""
    pilot.step(1e-3, [0.1, 0.2], [0.0, 0.0])
    assert pilot.reference.q[0] == pytest.approx(0.1, abs=1e-4)
    elsewhere = pilot.trajectory([0.0, 1.0], [[0.3, 0.2], [0.5, 0.2]])
    why = pilot.admit(elsewhere).violation
    assert law.text("taken", why.verdict) == "its first point is not where the arm is"
    assert why.joint == 1 and why.value == pytest.approx(0.2, abs=1e-3) and why.limit == 0.05


def test_no_trajectory_is_accepted_while_the_law_brings_the_arm_to_rest(law):
    pilot = at_rest(law)
    assert pilot.take([2.0], [[1.0, 0.2]], [[0.0, 0.0]]) == ""
    pilot.options.limited = pilot.options.outside = 10**6
    allow_error(pilot, 1e3)
    for _ in range(500):
        pilot.step(1e-3, [0.1, 0.2], [0.0, 0.0])
    pilot.rest()
    pilot.step(1e-3, [0.1, 0.2], [0.0, 0.0])
    assert pilot.take([2.0], [[0.0, 0.2]]) == "the law brings the arm to rest, and takes no trajectory before"
    for _ in range(1100):
        pilot.step(1e-3, [0.1, 0.2], [0.0, 0.0])
    assert pilot.take([2.0], [[0.0, 0.2]]) == "" and pilot.phase == "follow"


def test_a_trajectory_is_refused_before_the_begin_and_after_a_stop(law):
    pilot = following(law)
    assert pilot.take([1.0], [[0.1, 0.2]]) == "the law has no measured posture yet: begin first"
    pilot.begin([0.1, 0.2])
    pilot.step(0.0, [0.1, 0.2], [0.0, 0.0])
    assert pilot.step(1e-3, [5.0, 0.2], [0.0, 0.0]) == onboard.STOP
    assert pilot.take([1.0], [[0.1, 0.2]]) == "the control has stopped: begin again first"


EMPTY = """
#include "slidax_law_follow.h"
int main(void)
{
    static slidax_law_follow follow;
    slidax_law_reference reference;
    slidax_law_follow_at(&follow, 1.0, 1e-3, &reference);
    return reference.q[0] == 0.0 && reference.dq[0] == 0.0 && slidax_law_follow_ended(&follow, 1.0) ? 0 : 1;
}
"""


def test_a_reference_without_points_reads_only_memory_of_its_own(law, tmp_path):
    (tmp_path / "empty.c").write_text(EMPTY)
    checked = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", f"-I{law.folder}"]
    sources = [tmp_path / "empty.c", law.folder / "slidax_law_follow.c"]
    subprocess.run(["gcc", *checked, *sources, "-lm", "-o", tmp_path / "empty"], check=True)
    done = subprocess.run([tmp_path / "empty"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_posture_that_is_not_finite_is_refused_as_such_with_its_joint(law):
    for value in (math.nan, math.inf):
        pilot = law.pilot()
        assert not pilot.begin([0.1, value])
        assert pilot.why == "the measured posture is not finite (joint 2)"


def test_a_start_with_the_wrong_number_of_joints_ends_the_rehearsal_with_the_rule(law, capsys):
    with pytest.raises(SystemExit) as ended:
        rehearsal.main(["--law", str(law.folder), "--start", "0.1"])
    line = capsys.readouterr().err.splitlines()[-1]
    assert ended.value.code == 2 and line.endswith("--start must be 2 numbers, one for each joint; got 1")
