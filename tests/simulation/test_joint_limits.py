"""A start or a motion beyond the limits of the robot's joints is refused before any time passes."""

import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import MinimumJerk, Sinusoid
from slidax.simulation import states
from tests.simulation.simple import Spring

PANDA = scenarios.load("panda-payload").replace(t1=2.0, log_every=None)
HOME = np.asarray(PANDA.trajectory.offset)


def moved(joint, by):
    return np.where(np.arange(7) == joint, HOME + by, HOME)


def swinging(**changes):
    return PANDA.replace(trajectory=Sinusoid(**{"offset": HOME, "amplitude": 0.1, "frequency": 2.0} | changes))


@pytest.mark.parametrize("natively", [True, False])
@pytest.mark.parametrize(
    ("motion", "message"),
    [
        # 0.5 rad about -0.3 rad: sin 2t = 0.4604 for the first time at t = 0.2393 s.
        (
            {"offset": moved(3, 2.056), "amplitude": [0, 0, 0, 0.5, 0, 0, 0]},
            r"at t = 0.24 s joint `panda_joint4` is at -0.06911\d* rad, above its limit of -0.0698 rad",
        ),
        # 1.1 rad at 2 rad/s: 2.2 rad/s at the start, above 2.175 rad/s.
        (
            {"amplitude": [0, 0, 1.1, 0, 0, 0, 0]},
            r"at t = 0 s joint `panda_joint3` moves at 2.2 rad/s, above its limit of 2.175 rad/s",
        ),
    ],
)
def test_a_motion_beyond_a_limit_is_refused_with_joint_time_and_value(natively, motion, message, monkeypatch):
    monkeypatch.setattr(states.llvm, "available", lambda: natively)
    with pytest.raises(DefinitionError, match=message) as refused:
        swinging(**motion).simulate()
    assert "simulation.limits: ignore" in str(refused.value)


def test_motion_after_the_end_of_the_run_is_not_checked():
    there = moved(0, 3.0)
    late = PANDA.replace(trajectory=MinimumJerk.through([0.0, 4.0, 9.0], [HOME, HOME, there]), state0=State(HOME))
    states.require_within_limits(late.plant.robot, late.trajectory, late.state0, 2000, late.stepping)
    with pytest.raises(DefinitionError, match=r"`panda_joint1` is at 2\.(89|90)"):
        states.require_within_limits(late.plant.robot, late.trajectory, late.state0, 9000, late.stepping)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (State(moved(3, 2.4)), r"joint `panda_joint4` is at 0.044 rad, above its limit of -0.0698"),
        (State(HOME, [0, 0, 0, 0, -3.0, 0, 0]), r"joint `panda_joint5` moves at -3 rad/s, below its limit of -2.61"),
    ],
)
def test_a_start_beyond_a_limit_is_refused(state, message):
    with pytest.raises(DefinitionError, match=message):
        PANDA.replace(state0=state).simulate()


def test_a_limit_that_is_reached_exactly_is_accepted():
    robot = PANDA.plant.robot
    upper = State(jnp.where(jnp.arange(7) == 3, robot.limits.upper, HOME))
    still = MinimumJerk.through([0.0, 1.0], [upper.q, upper.q])
    states.require_within_limits(robot, still, upper, 1000, PANDA.stepping)


def test_limits_can_be_ignored_on_request():
    law = Spring(jnp.full(7, 10.0), jnp.full(7, 1.0), joints=7)
    wild = swinging(amplitude=[0, 0, 1.1, 0, 0, 0, 0]).replace(controller=law, state0=State(HOME), t1=0.01)
    assert int(wild.replace(limits="ignore").simulate().tally.samples) > 0
    with pytest.raises(DefinitionError, match="panda_joint3"):
        wild.simulate()


def test_a_scenario_file_can_ignore_limits():
    loaded = scenarios.load("panda-payload", {"simulation.limits": "ignore"})
    assert loaded.stepping.limits == "ignore"


# Every simulation makes this check, so that two scenarios are enough for the daily tests.
DAILY = ("example-4.1", "panda-pick")
NAMES = [pytest.param(name, marks=[] if name in DAILY else [pytest.mark.full]) for name in scenarios.names()]


@pytest.mark.parametrize("name", NAMES)
def test_the_built_in_scenarios_keep_their_robots_limits(name):
    loaded = scenarios.load(name)
    steps = round(loaded.t1 / loaded.period)
    states.require_within_limits(loaded.plant.robot, loaded.trajectory, loaded.state0, steps, loaded.stepping)


def test_joint_limits_are_not_checked_inside_a_jax_transformation():
    def end(amplitude):
        moved = dataclasses.replace(PANDA.trajectory, amplitude=amplitude)
        states.require_within_limits(PANDA.plant.robot, moved, PANDA.state0, 2000, PANDA.stepping)
        return moved.position(jnp.asarray(1.0))

    jax.jit(end)(jnp.full(7, 50.0))


def test_joint_limits_of_8000_samples_are_checked_within_a_quarter_second():
    motion = Sinusoid(offset=HOME, amplitude=0.05, frequency=1.0)
    started = time.process_time()
    states.require_within_limits(PANDA.plant.robot, motion, PANDA.state0, 8000, PANDA.stepping)
    assert time.process_time() - started < 0.25


def test_a_motion_that_a_batch_shares_is_checked_while_the_batch_is_traced():
    """The motion's times are known during tracing, although the start is not."""

    near, far = (MinimumJerk.through([0.0, 1.0], [HOME, moved(6, to)]) for to in (0.1, 9.0))

    def check(motion, start):
        states.require_within_limits(PANDA.plant.robot, motion, State(q=start), 2000, PANDA.stepping)
        return start

    jax.eval_shape(lambda start: check(near, start), jnp.asarray(HOME))
    with pytest.raises(DefinitionError, match=r"the motion is beyond .* joint `panda_joint7` is at .* above its limit"):
        jax.eval_shape(lambda start: check(far, start), jnp.asarray(HOME))
