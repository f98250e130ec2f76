"""The gate accepts motions that the arm can make, rejects the rest, and opens again after a permanent jump."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import couple, panda
from slidax.core import DefinitionError, State
from slidax.law import MeasurementGate
from slidax.plant import AbstractSensor, Measurement
from slidax.scenarios import load
from tests.paper_examples import SCARA

H = 1e-3
SPEED = np.array([2.0, 4.0])
GATE = MeasurementGate(q_max=jnp.array([3.0, 3.0]), speed=jnp.asarray(SPEED), acceleration=0.0)


def state(q, dq=(0.0, 0.0)):
    return State(q=jnp.asarray(q, float), dq=jnp.asarray(dq, float))


def judged(samples, gate=GATE, velocity=False, moving=0.0):
    """(accepted, restarts) of each sample `(t, state)` after a first one at t = 0 and q = 0."""
    memory, last, decisions = gate.init(jnp.zeros(()), state([0, 0]), velocity), jnp.zeros(()), []
    for t, measured in samples:
        predicted = memory.q + moving
        admission, memory = gate(jnp.asarray(t), measured, last, predicted, jnp.asarray(H), velocity, memory)
        last = jnp.where(admission.accepted, t, last)
        decisions.append((bool(admission.accepted), bool(admission.restarts)))
    return decisions


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_joint_may_move_at_its_largest_speed_for_two_periods(share):
    assert judged([(H, state(share * SPEED * 2 * H))]) == [(True, False)]


@pytest.mark.parametrize("joint", [0, 1])
def test_a_sample_beyond_the_speed_window_is_rejected_in_any_joint(joint):
    q = np.zeros(2)
    q[joint] = 1.01 * SPEED[joint] * 2 * H
    assert judged([(H, state(q))]) == [(False, False)]


def test_the_window_grows_with_the_time_since_the_last_accepted_sample():
    far = state([10 * 2.0 * H, 0.0])
    assert judged([(8 * H, far)]) == [(False, False)] and judged([(9.1 * H, far)]) == [(True, False)]


def test_a_position_beyond_its_range_is_never_accepted_however_often_it_comes():
    samples = [(k * H, state([3.1, 0.0])) for k in range(1, 40)]
    assert not any(accepted for accepted, _ in judged(samples))


def test_a_velocity_that_the_law_does_not_use_is_not_checked():
    assert judged([(H, state([0, 0], [np.nan, 1e300]))], velocity=False) == [(True, False)]


@pytest.mark.parametrize(("dq", "accepted"), [(1.5, True), (1.7, False), (-1.7, False), (1e4, False)])
def test_a_used_velocity_may_change_by_two_fifths_of_the_largest_speed_in_a_period(dq, accepted):
    way = 0.5 * dq * H
    assert judged([(H, state([way, 0], [dq, 0.0]))], velocity=True) == [(accepted, False)]


def test_a_velocity_that_contradicts_the_positions_is_rejected_for_as_long_as_it_lasts():
    samples = [(k * H, state([0, 0], [1.0, 0.0])) for k in range(1, 20)]
    assert judged(samples, velocity=True) == [(False, False)] * 19


def test_a_frozen_sensor_is_rejected_from_the_third_sample_on_if_motion_is_predicted():
    samples = [(k * H, state([0, 0])) for k in range(1, 6)]
    assert judged(samples, moving=1e-3) == [(True, False)] * 2 + [(False, False)] * 3
    assert judged(samples, moving=0.0) == [(True, False)] * 5


def test_a_joint_that_rests_while_the_drives_could_explain_the_prediction_is_not_frozen():
    """In a certified run, a working encoder returned bitwise the same position four times."""
    gate = eqx.tree_at(lambda part: part.acceleration, GATE, jnp.asarray(100.0))
    samples = [(k * H, state([0, 0])) for k in range(1, 4)]
    assert judged(samples, gate, moving=0.9 * 100.0 * H**2) == [(True, False)] * 3
    assert judged(samples, gate, moving=1.1 * 100.0 * H**2)[2] == (False, False)


def test_a_blocked_arm_restarts_the_law_once_the_patience_is_exceeded():
    samples = [(k * H, state([0, 0])) for k in range(1, 10)]
    assert judged(samples, moving=1e-3)[7] == (True, True)


def test_the_next_good_sample_after_an_outlier_is_accepted():
    assert judged([(H, state([2.0, 0.0])), (2 * H, state([0.0, 0.0]))]) == [(False, False), (True, False)]


def test_a_permanent_jump_is_accepted_after_more_samples_than_the_patience():
    samples = [(k * H, state([1.0, 0.0])) for k in range(1, 8)]
    assert judged(samples) == [(False, False)] * 5 + [(True, True), (True, False)]


def test_inconsistent_outliers_never_restart_the_law():
    samples = [(k * H, state([(-1.0) ** k, 0.0])) for k in range(1, 40)]
    assert not any(accepted for accepted, _ in judged(samples))


@pytest.mark.parametrize("jump", [-5.0, 1.0, 1e5])
def test_a_permanent_clock_jump_is_accepted_at_the_second_sample(jump):
    samples = [(jump + k * H, state([0, 0])) for k in range(1, 5)]
    assert judged(samples) == [(False, False), (True, True), (True, False), (True, False)]


@pytest.mark.parametrize("jump", [-5.0, 1.0, 1e5])
def test_one_wrong_time_stamp_is_one_lost_sample(jump):
    samples = [(H, state([0, 0])), (jump, state([0, 0])), (3 * H, state([0, 0]))]
    assert judged(samples) == [(True, False), (False, False), (True, False)]


def test_a_clock_that_stands_still_never_restarts_the_law():
    samples = [(H, state([0, 0]))] + [(H, state([0, 0]))] * 20
    assert judged(samples)[1:] == [(False, False)] * 20


def test_a_gap_of_up_to_100_periods_needs_no_confirmation():
    assert judged([(99 * H, state([0, 0]))]) == [(True, False)]
    assert judged([(101 * H, state([0, 0]))]) == [(False, False)]


def test_gate_ranges_follow_from_the_limits_of_the_arm():
    arm = panda()
    gate = MeasurementGate.of_arm(arm)
    farthest = np.maximum(np.abs(arm.limits.lower), np.abs(arm.limits.upper))
    np.testing.assert_allclose(gate.q_max, 1.5 * farthest)
    np.testing.assert_allclose(gate.speed, 4.0 * arm.limits.velocity)


def test_gate_ranges_of_an_arm_with_coupled_joints_are_those_of_its_leaders():
    arm = panda()
    gate = MeasurementGate.of_arm(couple(arm, {arm.joint_names[1]: (arm.joint_names[0], 2.0, 0.0)}))
    np.testing.assert_allclose(gate.q_max[0], 1.5 * 0.5 * arm.limits.upper[1])
    np.testing.assert_allclose(gate.speed[0], 4.0 * 0.5 * arm.limits.velocity[1])


def test_gate_speed_without_limits_is_reached_by_the_drives_in_a_turn_or_metre():
    arm = SCARA
    gate = MeasurementGate.of_arm(arm, torque=20.0, mass=jnp.diag(jnp.array([2.0, 0.5, 1.0])))
    np.testing.assert_allclose(gate.speed, np.sqrt([2 * 2 * np.pi * 40, 2 * 2 * np.pi * 160, 2 * 80]))
    np.testing.assert_allclose(MeasurementGate.of_arm(arm).speed, [100.0, 100.0, 20.0])
    np.testing.assert_allclose(gate.q_max, 1e4)


def test_a_patience_of_one_sample_is_refused():
    with pytest.raises(DefinitionError, match=r"`MeasurementGate\.patience` must be in \[2, 1e6\]; got 1"):
        MeasurementGate(patience=1.0)


class Faulty(AbstractSensor):
    """A sensor that adds `size` to the first joint for `samples` samples from sample `at` on."""

    at: int = eqx.field(static=True)
    size: float = eqx.field(static=True)
    samples: int = eqx.field(static=True, default=1)

    def init(self, state):
        return ()

    def __call__(self, k, state, period, memory):
        wrong = (k >= self.at) & (k < self.at + self.samples)
        q = state.q.at[0].add(jnp.where(wrong, self.size, 0.0))
        return Measurement(state=State(q=q, dq=state.dq), fresh=jnp.asarray(True)), ()


def run_with(sensor, engine, **changes):
    scenario = load("example-4.1-1khz", {"simulation.t1": 3.0, "start.q": [-0.1, 1.9], **changes})
    plant = eqx.tree_at(lambda plant: plant.sensor, scenario.plant, sensor, is_leaf=lambda x: x is None)
    return scenario.replace(plant=plant, engine=engine).simulate()


@pytest.mark.parametrize(("engine", "size"), [("native", 0.5), ("native", 1e6), ("xla", 40.0)])
def test_an_outlier_in_simulation_is_a_lost_sample_in_both_engines(engine, size):
    run = run_with(Faulty(1500, size), engine)
    assert np.flatnonzero(np.asarray(run.log.signals["rejected"])).tolist() == [1500]
    assert int(run.tally.rejected) == 1
    error = np.abs(np.asarray(run.log.state.q - run.log.reference.q))
    assert error[1500:].max() < 1e-3


@pytest.mark.parametrize("engine", ["native", pytest.param("xla", marks=pytest.mark.full)])
def test_a_lost_measurement_does_not_count_as_rejected(engine):
    outage = {"sensor.loss": {"outages": [{"start": 0.1, "samples": 20}]}}
    run = load("example-4.1-1khz", {"simulation.t1": 0.3, **outage}).replace(engine=engine).simulate(log_every=1)
    assert int(run.tally.rejected) == 0 and not np.any(run.log.signals["rejected"])


def test_a_permanent_encoder_slip_restarts_the_law_and_leaves_an_error_of_the_slip():
    run = run_with(Faulty(1500, 0.3, 10_000), "native", **{"simulation.outside": "recover"})
    rejected = np.flatnonzero(np.asarray(run.log.signals["rejected"]))
    assert rejected.tolist() == list(range(1500, 1505)) and int(run.tally.rejected) == 5
    error = np.asarray(run.log.state.q - run.log.reference.q)[-1]
    np.testing.assert_allclose(error, [-0.3, 0.0], atol=1e-3)
