"""A scenario's bound along its motion, and the admission of motions from files."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import admit, certified_law, judge_motion, slowed, tracking_bound
from slidax.certify.motion.path_cells import Pieces
from slidax.core.errors import DefinitionError
from slidax.motions.tabulated import Tabulated
from slidax.scenarios.family import Family
from tests.cli.commands import in_process

PANDA = "examples/motions/panda.yaml"


@pytest.fixture(scope="module")
def scenario():
    return sx.scenarios.load(PANDA)


@pytest.fixture(scope="module")
def law(scenario):
    return certified_law(scenario)


def motion(duration, reach=0.5):
    start = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    ends = np.stack([start, start + reach * np.array([1.0, 0.5, -0.5, 0.5, 0.3, 0.5, -0.5])])
    return Tabulated.through([0.0, duration], ends, np.zeros_like(ends), np.zeros_like(ends))


def test_simulated_arms_of_the_set_stay_within_the_tracking_bound(scenario):
    verdict = tracking_bound(scenario)
    assert verdict.holds and verdict.grade == "A"
    family = Family.of(scenario.description)
    rng = np.random.default_rng(0)
    drawn = family.uncertain.values(rng.random((3, family.uncertain.dimensions)))
    times, along = verdict.bound["times"], verdict.bound["error_over_time"]
    for k in range(3):
        log = family.scenario({path: values[k] for path, values in drawn.items()}, "arm").simulate().log
        assert not np.asarray(log.signals["rejected"]).any()
        cell = np.clip(np.searchsorted(times, np.asarray(log.t), side="right") - 1, 0, len(times) - 1)
        assert (np.abs(np.asarray(log.e)) <= along[cell]).all()
        assert np.abs(np.diff(np.asarray(log.tau), axis=0)).max() < verdict.bound["torque_step"].max()
        assert np.abs(np.asarray(log.tau)).max() < verdict.bound["torque"].max()


def test_arm_that_follows_streamed_positions_stays_within_the_tracking_bound(scenario):
    # The goal jumps every 0.5 s and is sent at 20 Hz: the filter generates the motion.
    times, start = np.arange(0.0, 1.5, 0.05), np.array(scenario.state0.q)
    goals = start + np.random.default_rng(0).uniform(-0.3, 0.3, (3, 7))
    goals[0] = start
    names = scenario.plant.robot.joint_names
    lines = [",".join(map(str, (round(t, 6), *goals[int(2 * t + 1e-9)]))) for t in times]
    stream = {"kind": "streamed", "text": "\n".join([f"time,{','.join(names)}", *lines]), "rate": 20.0}
    stream |= {"bandwidth": 20.0, "velocity": 0.5, "acceleration": 2.0, "jerk": 100.0}
    streamed = scenario.set({"trajectory": stream, "simulation.t1": 2.5})
    verdict = tracking_bound(streamed)
    assert verdict.holds and verdict.grade == "A"
    assert float(np.asarray(streamed.trajectory.behind).max()) > 0.2
    family = Family.of(streamed.description)
    drawn = family.uncertain.values(np.random.default_rng(1).random((1, family.uncertain.dimensions)))
    log = family.scenario({path: values[0] for path, values in drawn.items()}, "arm").simulate().log
    assert (np.abs(np.asarray(log.e)).max(axis=0) <= verdict.bound["error"]).all()


def test_measurement_gate_that_may_reject_valid_samples_lowers_the_grade():
    changes = {"scheme.sampled_data.gate": {"acceleration": 0.01, "spread": 1e-7}}
    verdict = tracking_bound(sx.scenarios.load(PANDA, changes))
    (line,) = (line for line in verdict.assumptions if "gate" in line.text)
    assert verdict.grade == "B" and line.status == "assumed" and line.value > 1.0


def test_wider_inertial_band_has_a_larger_tracking_bound(scenario):
    narrow, wide = (
        tracking_bound(sx.scenarios.load(PANDA, {"uncertainty": {"robot.plant.inertial": {"band": p}}})).bound["error"]
        for p in (0.01, 0.03)
    )
    assert (wide > narrow).all()


def test_known_payload_difference_enlarges_the_tracking_bound(scenario):
    # No band; the true payload is 0.1 kg heavier than the law's model.
    heavier = sx.scenarios.load(PANDA, {"uncertainty": {}, "robot.plant.load": {"mass": 0.1, "center": [0, 0, 0.1]}})
    exact = sx.scenarios.load(PANDA, {"uncertainty": {}})
    assert "a known difference" in tracking_bound(heavier).statement
    bounds = [tracking_bound(each).bound["error"] for each in (exact, heavier)]
    assert (bounds[1] > bounds[0]).all()
    assert (np.abs(np.asarray(heavier.simulate().log.e)).max(axis=0) < bounds[1]).all()


@pytest.mark.parametrize(
    ("changes", "words", "remedy"),
    [
        ({"scheme.sampled_data.midpoint": False}, "midpoint: true", {"scheme.sampled_data.midpoint": True}),
        ({"sensor.loss.probability": 0.01}, "sensor.loss", {"sensor.loss.probability": 0.0}),
        ({"sensor.jitter": 0.1}, "sensor.jitter: 0", {"sensor.jitter": 0.0}),
        ({"actuator.time_constant": 0.002}, "actuator.time_constant: 0", {"actuator.time_constant": 0.0}),
        (
            {"robot.plant.load": {"mass": 1.0, "attached": 0.5}},
            "robot.plant.load.attached: 0",
            {"robot.plant.load": {"mass": 0.1}, "uncertainty": {}},
        ),
    ],
)
def test_setting_outside_the_tracking_bounds_scope_is_named_with_a_valid_remedy(changes, words, remedy):
    verdict = tracking_bound(sx.scenarios.load(PANDA, changes))
    assert verdict.holds is None and words in verdict.statement
    assert tracking_bound(sx.scenarios.load(PANDA, changes | remedy)).holds


def test_motion_that_is_too_fast_is_admitted_after_the_suggested_slowdown(law):
    answer = admit(law, motion(0.33), allowed=0.003)
    assert not answer.admitted and answer.limit is not None and answer.slow_down is not None
    assert judge_motion(law, slowed(motion(0.33), answer.slow_down), 0.003).step_proved
    assert admit(law, slowed(motion(0.33), answer.slow_down), allowed=0.003).admitted
    assert not admit(law, slowed(motion(0.33), 0.8 * answer.slow_down), allowed=0.003, slow_down=False).admitted


def test_motion_beyond_a_joints_range_is_refused_with_the_joint_name(law):
    answer = admit(law, motion(4.0, reach=3.5), slow_down=False)
    assert not answer.admitted
    assert answer.limit.what == "position" and answer.limit.joint in law.arm.joint_names
    assert abs(answer.limit.value) > abs(answer.limit.allowed)


def test_a_slowed_motion_passes_the_same_positions_later():
    fast, slow = motion(1.0), slowed(motion(1.0), 1.7)
    for t in (0.0, 0.3, 0.9, 1.2):
        np.testing.assert_allclose(fast.position(jnp.asarray(t)), slow.position(jnp.asarray(1.7 * t)), atol=1e-12)


def test_unproved_torque_steps_lower_the_grade_and_need_assume_steps_for_admission(law):
    tight = replace(law, torque_rate=0.2 * law.torque_rate)
    refused = admit(tight, motion(1.5), slow_down=False)
    assert not refused.admitted and refused.limit.what == "torque step" and refused.verdict.holds
    assert refused.verdict.grade == "B"
    assert admit(tight, motion(1.5), assume_steps=True, slow_down=False).admitted


def test_motion_whose_planned_torque_step_exceeds_the_rate_limit_is_always_refused(law):
    arm, h, path = law.arm, law.loop.period, Pieces.of(motion(1.5))
    q, dq = (np.asarray(part) for part in path.at(np.arange(0.0, 1.5, h))[:2])
    mean = np.diff(dq, axis=0) / h
    q, dq = q[:-1] + 0.5 * h * dq[:-1] + 0.125 * h * h * mean, dq[:-1] + 0.5 * h * mean
    planned = jax.vmap(lambda q, dq, ddq: arm.mass(q) @ ddq + arm.bias(q, dq))(q, dq, mean) + arm.viscous * dq
    needed = float(np.abs(np.diff(planned, axis=0)).max())
    answers = [
        admit(replace(law, torque_rate=np.full(7, share * needed / h)), motion(1.5), assume_steps=True, slow_down=False)
        for share in (0.99, 1.02)
    ]
    assert [answer.admitted for answer in answers] == [False, True]
    limit = answers[0].limit
    assert limit.what == "planned torque step" and limit.value == pytest.approx(needed, rel=1e-2)
    assert [line.status for line in answers[0].verdict.assumptions if "torque step" in line.text] == ["fails", "fails"]


def test_admit_command_reports_each_motion_in_json_and_exits_with_4_on_refusal(tmp_path, law):
    names = ",".join(reversed(law.arm.joint_names))
    for name, duration in (("slow", 1.5), ("fast", 0.3)):
        moved = motion(duration)
        times = np.linspace(0.0, duration, 12)
        rows = [
            ",".join(map(repr, [t, *np.asarray(moved.position(jnp.asarray(t)))[::-1].tolist()])) for t in times.tolist()
        ]
        (tmp_path / f"{name}.csv").write_text("\n".join([f"time,{names}", *rows]) + "\n")
    files = [str(tmp_path / f"{name}.csv") for name in ("slow", "fast")]
    result = in_process("admit", *files, "--scenario", PANDA, "--json")
    assert result.exit_code == 4
    slow, fast = json.loads(result.output)["motions"]
    assert slow["admitted"] and slow["slow_down"] == 1.0 and slow["limit"] is None and len(slow["bound"]) == 7
    assert not fast["admitted"] and fast["limit"]["joint"] in law.arm.joint_names and fast["file"] == files[1]
    assert in_process("admit", files[0], "--scenario", PANDA).exit_code == 0


def test_law_outside_the_tracking_bounds_scope_is_refused_with_the_required_setting():
    with pytest.raises(DefinitionError, match=r"set `scheme\.sampled_data\.adaptation: null`"):
        certified_law(sx.scenarios.load("panda-payload"))
