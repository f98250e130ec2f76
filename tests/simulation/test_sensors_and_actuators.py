"""Sensors and actuators in the loop: the law gets the measurements, the arm the delivered torques."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slidax.core.types import State
from slidax.motions import ConstantPosture as Still
from slidax.plant import Actuator, Constant, Delayed, Encoders, Exact, Lossy, TorqueLimits
from slidax.simulation import Plant, simulate
from tests.enrolled import assert_same, every
from tests.paper_examples import MOTION_4_1, START_4_1, TWO_LINK
from tests.plant.sensors.members import LIKE_OTHERS, SENSORS
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Pendulum, Spring, Witness

PERIOD = 1e-2
SAMPLES = 51
WITNESS = Witness(SPRING)


def run(sensor=None, actuator=None, law=WITNESS, **extra):
    plant = Plant(TWO_LINK, SMOOTH_PLANT.disturbance, sensor, actuator)
    return simulate(plant, law, MOTION_4_1, START_4_1, **{"t1": 0.5, "period": PERIOD} | extra)


def measured(sensor, log):
    """Measurements of the logged states by the sensor."""

    def sample(memory, now):
        k, state = now
        measurement, memory = sensor(k, state, jnp.asarray(PERIOD), memory)
        return memory, measurement

    states = jax.tree.map(jnp.asarray, log.state)
    first = jax.tree.map(lambda x: x[0], states)
    return jax.lax.scan(sample, sensor.init(first), (jnp.asarray(log.k), states))[1]


@every("sensor", SENSORS, full=LIKE_OTHERS)
def test_a_controller_gets_the_samples_of_the_sensor(sensor):
    log = run(sensor).log
    measurements = measured(sensor, log)
    np.testing.assert_allclose(log.signals["q"], measurements.state.q, rtol=1e-12)
    np.testing.assert_allclose(log.signals["dq"], measurements.state.dq, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(log.signals["first"], np.broadcast_to(log.signals["q"][0], (SAMPLES, 2)))


@every("sensor", SENSORS, full=LIKE_OTHERS)
def test_the_torque_changes_only_with_samples_that_arrived(sensor):
    log = run(sensor).log
    fresh = np.asarray(measured(sensor, log).fresh)
    e, de = log.signals["q"] - log.reference.q, log.signals["dq"] - log.reference.dq
    answer = -np.asarray(SPRING.stiffness) * e - np.asarray(SPRING.damping) * de
    np.testing.assert_allclose(log.tau[fresh], answer[fresh], rtol=1e-12, atol=1e-10)
    lost = np.flatnonzero(~fresh)
    np.testing.assert_array_equal(log.tau[lost], log.tau[lost - 1])


def test_a_delay_of_one_period_shifts_samples_by_one_period():
    log = run(Delayed(Exact(), 1.0)).log
    np.testing.assert_array_equal(log.signals["q"][1:], log.state.q[:-1])
    np.testing.assert_array_equal(log.signals["dq"][1:], log.state.dq[:-1])
    assert np.all(log.signals["q"][2:] != log.state.q[2:])


def test_torque_and_memory_are_held_while_samples_are_lost():
    log = run(Lossy(Exact(), starts=[10], counts=[5])).log
    np.testing.assert_array_equal(log.tau[10:15], np.broadcast_to(log.tau[9], (5, 2)))
    assert np.all(log.tau[15] != log.tau[9])
    counts = np.concatenate([np.arange(10), np.full(5, 10), np.arange(10, SAMPLES - 5)])
    np.testing.assert_array_equal(log.signals["count"], counts)


def test_the_envelope_is_judged_by_the_true_error_and_not_by_the_measured_one():
    """The law gets no sample after the first, so that its measured error stays small."""
    start = State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([1.0, 0.0]))
    law = BoundedLaw(Spring(jnp.zeros(2), jnp.zeros(2)), jnp.asarray(0.095))

    def outcome(sensor):
        plant = Plant(TWO_LINK, SMOOTH_PLANT.disturbance, sensor)
        return simulate(plant, law, Still([np.pi / 2, 0.0]), start, t1=1.0, period=0.04).outcome

    late = outcome(Lossy(Exact(), starts=[1], counts=[100]))
    assert late == outcome(None)
    assert late.kind == "left_envelope"


def test_logged_and_tallied_torques_are_within_the_actuators_limits():
    limits = TorqueLimits([40.0, 25.0], [1500.0, 600.0])
    free, limited = run(), run(actuator=Actuator(limits))
    assert np.all(np.abs(free.log.tau).max(axis=0) > limits.torque)
    log, tally = limited.log, limited.tally
    held = TWO_LINK.bias(START_4_1.q, START_4_1.dq)
    steps = np.abs(np.diff(np.concatenate([np.asarray(held)[None], log.tau]), axis=0))
    assert np.all(np.abs(log.tau) <= limits.torque)
    assert np.all(steps <= np.asarray(limits.rate) * PERIOD * (1 + 1e-12))
    np.testing.assert_allclose(np.abs(log.tau).max(axis=0), limits.torque)
    np.testing.assert_allclose(steps.max(axis=0), np.asarray(limits.rate) * PERIOD)
    counted = {
        "peak_torque": np.abs(log.tau).max(axis=0),
        "first_torque": log.tau[0],
        "torque_square": (log.tau**2).sum(axis=0),
        "torque_travel": steps[1:].sum(axis=0),
        "max_step": steps[1:].max(axis=0),
    }
    for name, value in counted.items():
        np.testing.assert_allclose(getattr(tally, name), value, rtol=1e-12, err_msg=name)


def test_the_arm_moves_by_the_limited_torque():
    limited = run(actuator=Actuator(TorqueLimits([40.0, 25.0])), law=Spring(1e5 * jnp.ones(2), jnp.zeros(2)))
    signs = run(actuator=Actuator(TorqueLimits([40.0, 25.0])), law=Spring(1e9 * jnp.ones(2), jnp.zeros(2)))
    np.testing.assert_array_equal(limited.log.state.q[:5], signs.log.state.q[:5])
    assert np.all(np.abs(limited.log.tau[:5]) == [40.0, 25.0])


LAG, DEAD, STEP = 0.03, 1.3, 0.05
LAW_OF_ONE = Spring(jnp.array([12.0]), jnp.array([4.0]), joints=1)


def by_scipy(samples):
    """Integrate the pendulum under its spring with the drive's lag and dead time, command by command."""
    q, dq, torque = 0.8, 0.0, 3.0 * np.sin(0.8)
    commands, states = [torque, torque], []

    def rate(t, y, command):
        return [y[1], 0.5 * (y[2] - 3.0 * np.sin(y[0])), (command - y[2]) / LAG]

    for _ in range(samples):
        states.append((q, dq))
        commands.append(-12.0 * (q - 0.2) - 4.0 * dq)
        for command, share in ((commands[-3], 0.3), (commands[-2], 0.7)):
            extra = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "args": (command,)}
            q, dq, torque = solve_ivp(rate, (0.0, share * STEP), [q, dq, torque], **extra).y[:, -1]
    return np.array(states)


def test_actuator_dead_time_and_lag_match_an_independent_integration():
    start = State(q=jnp.array([0.8]), dq=jnp.zeros(1))

    def simulated(actuator):
        plant = Plant(Pendulum(), Constant([0.0]), None, actuator)
        log = simulate(plant, LAW_OF_ONE, Still([0.2]), start, t1=3.0, period=STEP, substeps=20).log
        return np.concatenate([log.state.q, log.state.dq], axis=1)

    right = by_scipy(61)
    np.testing.assert_allclose(simulated(Actuator(time_constant=LAG, dead_time=DEAD)), right, atol=1e-7)
    for wrong in (Actuator(time_constant=LAG), Actuator(dead_time=DEAD), Actuator(time_constant=LAG, dead_time=1.0)):
        assert np.abs(simulated(wrong) - right).max() > 1e-2


def test_a_perfect_sensor_and_a_perfect_actuator_change_nothing():
    bare, perfect = run(), run(Exact(), Actuator())
    assert_same((perfect.log, perfect.tally, perfect.state), (bare.log, bare.tally, bare.state), rtol=1e-13)


NOISY = Encoders(1e-4, 1e-4, 1e-2, seed=1)


def test_equal_seeds_give_equal_bits_and_other_seeds_other_bits():
    again, other = run(NOISY), run(eqx.tree_at(lambda s: s.seed, NOISY, jnp.asarray(2)))
    assert_same((again.log, again.tally), (run(NOISY).log, run(NOISY).tally))
    assert np.all(other.log.tau[1:] != again.log.tau[1:])


@pytest.mark.parametrize("log_every", [None, 7])
def test_the_tally_with_sensors_and_drives_does_not_depend_on_the_log(log_every):
    parts = (Lossy(Delayed(NOISY, 1.4), 0.2), Actuator(TorqueLimits(40.0, 900.0), 5e-3, 0.5))
    assert_same(run(*parts, log_every=log_every).tally, run(*parts).tally)
