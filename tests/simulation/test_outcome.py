"""Failed runs: the outcome names the joint and the time, and the log before the failure is kept."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import OutcomeError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.simulation import simulate
from slidax.simulation.outcome import Fault, describe_outcome
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Breaks, Spring

AT_1_KHZ = {"t1": 10.0, "period": 1e-3}


def assert_finite(*parts):
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(parts))


@cache
def printed_law_at_1_khz(mode):
    return simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, mode=mode, **AT_1_KHZ)


@pytest.mark.parametrize(("mode", "when"), [("continuous", 5.51), ("held", 4.85)])
def test_the_papers_law_leaves_its_envelope_at_1_khz_and_the_earlier_log_is_kept(mode, when):
    run = printed_law_at_1_khz(mode)
    outcome, log, tally = run.outcome, run.log, run.tally
    assert (outcome.kind, outcome.ok, outcome.joint) == ("left_envelope", False, 1)
    # The last 0.2 s are a limit cycle that grows from rounding: the compiler's choices move the exit by milliseconds.
    assert outcome.t == pytest.approx(when, abs=0.05)
    assert abs(outcome.error) > abs(outcome.bound)
    numbers = f"t = {outcome.t:.4g} s", f"e = {outcome.error:.4g} rad", f"bound {outcome.bound:.4g} rad"
    for part in ("Joint 1 left its envelope", *numbers, "shorten the period"):
        assert part in outcome.message
    assert_finite(log, tally, run.state)
    assert np.all(log.valid)
    assert log.t[-1] < outcome.t <= log.t[-1] + 1.5e-3
    assert np.all((log.envelope.lower < log.e) & (log.e < log.envelope.upper))
    assert int(tally.samples) == len(log.t)
    np.testing.assert_allclose(tally.torque_square, (log.tau**2).sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(tally.last_torque, log.tau[-1], rtol=1e-14)
    if mode == "held":
        assert int(tally.violations) == 1
        assert outcome.t == pytest.approx(log.t[-1] + 1e-3)


@pytest.mark.parametrize("mode", ["continuous", "held"])
def test_an_unlogged_run_has_the_outcome_of_the_logged_run(mode):
    run = simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, mode=mode, log_every=None, **AT_1_KHZ)
    logged = printed_law_at_1_khz(mode).outcome
    assert run.log is None
    assert (run.outcome.kind, run.outcome.joint) == (logged.kind, logged.joint)
    assert run.outcome.t == pytest.approx(logged.t, abs=0.05)
    assert_finite(run.tally, run.state)


FALLING = {
    "trajectory": ConstantPosture([np.pi / 2, 0.0]),
    "state0": State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([1.0, 0.0])),
    "t1": 1.0,
    "period": 0.04,
}
FREE = Spring(jnp.zeros(2), jnp.zeros(2))


@pytest.mark.parametrize(("mode", "when"), [("continuous", 0.10), ("held", 0.12)])
def test_the_exit_time_in_continuous_mode_is_that_of_the_first_integrator_stage_outside(mode, when):
    """The error grows like t and reaches 0.095 between the samples at 0.08 s and 0.12 s, before the stage at 0.10 s."""
    run = simulate(SMOOTH_PLANT, BoundedLaw(FREE, jnp.asarray(0.095)), mode=mode, **FALLING)
    assert (run.outcome.kind, run.outcome.joint) == ("left_envelope", 1)
    assert run.outcome.t == pytest.approx(when, abs=1e-12)
    assert run.outcome.bound == 0.095 < run.outcome.error < 1.3 * when
    assert run.log.t[-1] == pytest.approx(0.08)
    assert int(run.tally.samples) == 3
    assert int(run.tally.violations) == (mode == "held")


def test_an_envelope_violation_between_samples_is_detected_in_continuous_mode_only():
    """All samples are inside, and a stage between two samples is not."""

    class Window(BoundedLaw):
        """A tolerance band that is narrow around t = 0.1 only, between two samples."""

        def envelope(self, t, memory):
            wide = jnp.where(jnp.abs(t - 0.1) < 0.01, self.radius, 10.0) * jnp.ones(2)
            return eqx.tree_at(lambda e: (e.lower, e.upper), BoundedLaw.envelope(self, t, memory), (-wide, wide))

    law = Window(FREE, jnp.asarray(0.05))
    assert simulate(SMOOTH_PLANT, law, mode="held", **FALLING).outcome.ok
    outcome = simulate(SMOOTH_PLANT, law, mode="continuous", **FALLING).outcome
    assert outcome.kind == "left_envelope"
    assert outcome.t == pytest.approx(0.1)


@pytest.mark.parametrize("mode", ["continuous", "held"])
def test_throw_raises_an_error_with_the_outcome_and_the_run(mode):
    with pytest.raises(OutcomeError, match="Joint 1 left its envelope") as caught:
        simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, mode=mode, throw=True, **AT_1_KHZ)
    assert caught.value.outcome == printed_law_at_1_khz(mode).outcome
    assert len(caught.value.run.log.t) == len(printed_law_at_1_khz(mode).log.t)


@pytest.mark.parametrize("mode", ["continuous", "held"])
@pytest.mark.parametrize("joint", [1, 2])
def test_a_torque_that_is_nan_ends_the_run_and_names_the_joint(mode, joint):
    law = Breaks(SPRING, jnp.asarray(0.2), joint)
    run = simulate(SMOOTH_PLANT, law, MOTION_4_1, START_4_1, t1=1.0, period=0.01, mode=mode)
    assert (run.outcome.kind, run.outcome.joint) == ("not_finite", joint)
    assert run.outcome.t == pytest.approx(0.2, abs=0.0101)
    assert f"Joint {joint} became infinite or undefined at t = 0.2" in run.outcome.message
    assert_finite(run.log, run.state)
    assert run.log.t[-1] < 0.2


def test_an_unstable_loop_ends_with_an_outcome_not_with_nan():
    law = Spring(-1e4 * jnp.ones(2), -1e4 * jnp.ones(2))
    run = simulate(SMOOTH_PLANT, law, MOTION_4_1, START_4_1, t1=100.0, period=0.05)
    assert run.outcome.kind == "not_finite"
    assert_finite(run.log, run.state)


@pytest.mark.parametrize("target", [0.5, -0.5])
def test_the_outcome_has_the_bound_upper_or_lower_that_the_error_reached(target):
    law = BoundedLaw(FREE, jnp.asarray(0.1))
    start = State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([target, 0.0]))
    run = simulate(SMOOTH_PLANT, law, ConstantPosture([np.pi / 2, 0.0]), start, t1=2.0, period=0.01)
    assert (run.outcome.kind, run.outcome.joint) == ("left_envelope", 1)
    assert run.outcome.bound == pytest.approx(np.sign(target) * 0.1)
    assert np.sign(run.outcome.error) == np.sign(target)


def test_a_run_without_faults_has_outcome_ok_without_time_or_joint():
    run = simulate(SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1, t1=0.5, period=0.01, throw=True)
    assert (run.outcome.ok, run.outcome.t, run.outcome.joint) == (True, None, None)


def test_outcome_messages_use_joint_names_where_the_robot_has_them() -> None:
    numbers = {"t": 0.5, "joint": 1, "error": 0.2, "bound": 0.1}
    fault = Fault(kind=jnp.asarray(1), **{name: jnp.asarray(value) for name, value in numbers.items()})
    outcome = describe_outcome(fault, None, 0, 1e-3, ("rad", "m"), ("base yaw", "lift"))
    assert outcome.message.startswith("Joint `lift` left its envelope at t = 0.5 s (e = 0.2 m") and outcome.joint == 2
    outcome = describe_outcome(fault, None, 0, 1e-3, ("rad", "m"), ("joint 1", "joint 2"))
    assert outcome.message.startswith("Joint 2 left its envelope")
