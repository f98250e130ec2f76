"""Arguments that `simulate` refuses before a run, and its messages."""

import jax.numpy as jnp
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import sampled_data
from slidax.plant import Actuator, Constant, Exact, TorqueLimits
from slidax.simulation import Plant, simulate
from tests.paper_examples import MOTION_4_1, MOTION_4_2, SCARA, START_4_1, TWO_LINK, law_4_1, law_4_2, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

ON_THREE_JOINTS = Constant([0.0, 0.0, 0.0])


def plant_parts():
    return plant_4_1().robot, plant_4_1().disturbance


def attempt(plant=None, law=None, trajectory=MOTION_4_1, start=START_4_1, **times):
    times = {"t1": 0.01, "period": 1e-3} | times
    return simulate(plant or plant_4_1(), law or law_4_1(), trajectory, start, **times)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": -1e-3}, r"`Stepping.period` must be > 0 s; got -0.001"),
        ({"period": 0.0}, r"`Stepping.period` must be > 0 s; got 0"),
        ({"period": float("nan")}, r"`Stepping.period` must be > 0 s; got nan"),
        ({"t1": 0.0}, r"`t1` must be > 0 s; got 0"),
        ({"t1": float("inf")}, r"`t1` must be > 0 s; got inf"),
        ({"t1": 0.0105}, r"`t1` must be a whole number of periods of 0.001 s; got 0.0105 s"),
        ({"t1": 1e-4}, r"`t1` must be a whole number of periods"),
        ({"substeps": 0}, r"`Stepping.substeps` must be in \[1, 10000\]; got 0"),
        ({"substeps": 2, "mode": "continuous"}, r"`Stepping.substeps` must be 1 in continuous mode.*got 2"),
        ({"log_every": 0}, r"`log_every` must be in \[1, 1e\+09\], or None for no log; got 0"),
    ],
)
def test_invalid_durations_periods_substeps_and_log_intervals_are_refused(change, message):
    with pytest.raises(DefinitionError, match=message):
        attempt(**change)


# The refusal comes before the engine starts, so the engine that compiles quickly is enough for every day.
@pytest.mark.parametrize("engine", ["native", pytest.param("xla", marks=pytest.mark.full)])
@pytest.mark.parametrize("outside", ["raise", "recover"])
def test_a_start_that_the_actuator_cannot_hold_is_refused(engine, outside):
    """The message has the joint, its holding torque, the limit and the remedy; joint 2 is too weak."""
    held = TWO_LINK.bias(START_4_1.q, START_4_1.dq)
    assert -6.0 < held[1] < -5.0
    weak = Plant(*plant_parts(), actuator=Actuator(TorqueLimits([60.0, 5.0])))
    message = rf"joint 2 needs {held[1]:.4g} N m there, but its limit is 5 N m; raise it, or start in a posture"
    with pytest.raises(
        DefinitionError, match=r"`TorqueLimits.torque` must hold the arm in its initial posture: " + message
    ):
        attempt(weak, engine=engine, outside=outside)
    enough = Plant(*plant_parts(), actuator=Actuator(TorqueLimits([60.0, 6.0])))
    attempt(enough, engine=engine, outside=outside)


@pytest.mark.parametrize(("t1", "period", "samples"), [(0.3, 0.1, 4), (1.0, 1 / 3, 4), (0.7, 0.07, 11)])
def test_a_duration_of_whole_periods_is_accepted_in_spite_of_rounding(t1, period, samples):
    run = simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=t1, period=period)
    assert int(run.tally.samples) == samples


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([-0.4, 2.7], r"got e\(0\) = 0.7 for joint 2, whose bounds are -0.12 and 0.6"),
        ([-0.7, 2.5], r"got e\(0\) = -0.9 for joint 1, whose bounds are -0.8 and 0.16"),
        ([1.001, 2.5], r"got e\(0\) = 0.801 for joint 1, whose bounds are -0.16 and 0.8"),
    ],
)
def test_a_start_outside_the_envelope_is_refused(q, message):
    with pytest.raises(DefinitionError, match=message) as refused:
        attempt(start=State(q=jnp.array(q), dq=jnp.zeros(2)))
    for part in ("eq. 12", "|e(0)| < rho0", "eq. 20", "enlarge the initial radius"):
        assert part in str(refused.value)


def test_a_start_without_any_error_is_accepted():
    start = State(q=MOTION_4_1.position(jnp.zeros(())), dq=jnp.zeros(2))
    assert attempt(start=start).outcome.ok


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (
            State(q=jnp.zeros(3), dq=jnp.zeros(3)),
            r"`state0.q` must have one entry for each of the 2 joints; got \(3,\)",
        ),
        (State(q=jnp.array([0.0, jnp.nan]), dq=jnp.zeros(2)), r"`state0.q` must be finite; it is not for joint 2"),
        (State(q=START_4_1.q, dq=jnp.array([jnp.inf, 0.0])), r"`state0.dq` must be finite; it is not for joint 1"),
    ],
)
def test_a_start_of_wrong_length_or_with_non_finite_entries_is_refused(start, message):
    with pytest.raises(DefinitionError, match=message):
        attempt(start=start)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": law_4_2()}, "the controller commands 3 joints, but the plant has 2"),
        ({"plant": Plant(SCARA, ON_THREE_JOINTS)}, "the controller commands 2 joints, but the plant has 3"),
        ({"trajectory": MOTION_4_2}, r"the trajectory gives \[3\] positions, but the plant has 2 joints"),
        ({"plant": plant_4_1(ON_THREE_JOINTS)}, r"the disturbance gives \[3\] forces, but the plant has 2 joints"),
    ],
)
def test_parts_for_another_number_of_joints_are_refused(change, message):
    with pytest.raises(DefinitionError, match=message):
        attempt(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"plant": Plant(*plant_parts(), Exact())}, "a sensor needs samples: simulate in held mode"),
        ({"plant": Plant(*plant_parts(), None, Actuator())}, "an actuator needs samples: simulate in held mode"),
        ({"law": sampled_data(law_4_1(), period=1e-3)}, "a sampled-data law needs samples: simulate in held mode"),
        ({"outside": "recover"}, "`Stepping.outside` must be `raise` in continuous mode: recovering needs samples"),
    ],
)
def test_sampled_parts_are_refused_in_continuous_mode(change, message):
    assert attempt(**change).outcome.ok
    with pytest.raises(DefinitionError, match=message):
        attempt(mode="continuous", **change)


def test_a_sampled_data_law_designed_for_another_period_is_refused():
    law = sampled_data(law_4_1(), period=2e-3)
    assert attempt(law=law, period=2e-3).outcome.ok
    with pytest.raises(DefinitionError, match=r"designed for a period of 0.002 s; it cannot be sampled every 0.001 s"):
        attempt(law=law, period=1e-3)
