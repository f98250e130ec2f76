"""Runs that continue outside their envelope: their counts, outcomes and messages."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError, OutcomeError
from slidax.core.types import State
from slidax.motions import ConstantPosture
from slidax.simulation import simulate
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING, BoundedLaw, Breaks, Spring

PERIOD = 0.02
RINGING = Spring(jnp.array([300.0, 150.0]), jnp.array([25.0, 3.0]))
STILL = ConstantPosture([np.pi / 2, 0.0])
PUSHED = State(q=jnp.array([np.pi / 2, 0.0]), dq=jnp.array([1.0, -2.0]))


def run(radius=0.1, t1=3.0, start=PUSHED, law=RINGING, outside="recover", **extra):
    bounded = BoundedLaw(law, jnp.asarray(radius))
    return simulate(SMOOTH_PLANT, bounded, STILL, start, t1=t1, period=PERIOD, outside=outside, **extra)


@cache
def came_back():
    return run()


def over(log, radius=0.1):
    """Return the excess of each joint's error over the radius at each sample; an excess of 0 is outside."""
    return np.abs(log.e) - radius


def test_a_recovered_outcome_has_exit_and_return_times_error_bound_and_largest_excess():
    done = came_back()
    beyond = over(done.log)
    outside = np.flatnonzero((beyond >= 0).any(axis=1))
    # The error leaves and returns several times; `back` is the final return.
    assert len(outside) > 5 and np.any(np.diff(outside) > 1)
    first, joint = outside[0], int(np.argmax(beyond[outside[0]]))
    outcome = done.outcome
    assert (outcome.kind, outcome.ok, outcome.joint) == ("recovered", False, joint + 1)
    assert outcome.t == pytest.approx(first * PERIOD)
    assert outcome.back == pytest.approx((outside[-1] + 1) * PERIOD)
    assert outcome.error == pytest.approx(done.log.e[first, joint])
    assert outcome.bound == pytest.approx(0.1 * np.sign(outcome.error))
    assert outcome.beyond == pytest.approx(beyond.max())
    assert int(done.tally.violations) == len(outside)


def test_a_recovered_message_has_exit_and_return_times_sample_count_and_largest_excess():
    done, outcome = came_back(), came_back().outcome
    worst = int(np.argmax(over(done.log).max(axis=0))) + 1
    assert outcome.message == (
        f"Joint {outcome.joint} left its envelope at t = {outcome.t:.4g} s (e = {outcome.error:.4g} rad, bound "
        f"{outcome.bound:.4g} rad), and was back for good at t = {outcome.back:.4g} s: {int(done.tally.violations)} "
        f"samples were outside, by at most {outcome.beyond:.3g} rad (joint {worst})."
    )


def test_a_recovered_run_continues_to_its_end_and_counts_every_sample():
    done = came_back()
    assert int(done.tally.samples) == len(done.log.t) == 151
    assert np.all(done.log.valid)
    np.testing.assert_allclose(done.tally.torque_square, (done.log.tau**2).sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(done.tally.margin, -over(done.log).max(axis=0) / 0.2, rtol=1e-12)


def test_the_outcome_does_not_depend_on_what_is_logged():
    assert run(log_every=None).outcome == came_back().outcome


def test_a_run_that_ends_outside_its_envelope_has_outcome_left_envelope():
    end = came_back().outcome.t + PERIOD
    done = run(t1=end)
    assert over(done.log)[-1].max() >= 0
    outcome = done.outcome
    assert outcome.kind == "left_envelope"
    assert outcome.back is None
    assert outcome.beyond == pytest.approx(over(done.log).max())
    for words in ("left its envelope at t = ", "is outside at the end: 2 samples were outside"):
        assert words in outcome.message


def test_the_outcome_names_the_joint_that_left_first_even_if_another_leaves_farther():
    start = State(q=PUSHED.q, dq=jnp.array([3.0, 2.0]))
    done = run(start=start)
    beyond = over(done.log)
    first = np.argmax((beyond >= 0).any(axis=1))
    last = np.flatnonzero((beyond >= 0).any(axis=1))[-1]
    assert (np.argmax(beyond[first]), np.argmax(beyond[last])) == (0, 1)
    assert done.outcome.joint == 1
    assert done.outcome.error == done.log.e[first, 0]
    assert done.outcome.beyond == pytest.approx(beyond[:, 1].max())
    assert beyond[:, 1].max() > beyond[:, 0].max()
    assert "(joint 2)" in done.outcome.message


def test_the_message_for_a_single_sample_outside_is_in_the_singular():
    outcome = run(t1=came_back().outcome.t).outcome
    assert "is outside at the end: 1 sample was outside, by" in outcome.message


def test_the_message_of_a_run_that_starts_outside_has_error_and_bound():
    start = State(q=jnp.array([np.pi / 2 + 0.3, 0.05]), dq=jnp.zeros(2))
    outcome = run(start=start, law=SPRING).outcome
    assert (outcome.kind, outcome.t, outcome.joint) == ("recovered", 0.0, 1)
    assert outcome.message.startswith(
        "Joint 1 was outside its envelope from the start (e = 0.3 rad, bound 0.1 rad), and was back for good at t = "
    )
    assert outcome.beyond >= 0.2
    with pytest.raises(DefinitionError, match="must start inside the envelope"):
        run(start=start, law=SPRING, outside="raise")


def test_an_error_on_its_bound_is_outside():
    start = State(q=jnp.array([np.pi / 2 + 0.125, 0.0]), dq=jnp.zeros(2))
    e = float(start.q[0] - STILL.position(jnp.zeros(()))[0])
    outcome = run(radius=e, start=start, law=SPRING).outcome
    assert (outcome.kind, outcome.t, outcome.beyond) == ("recovered", 0.0, pytest.approx(0.0, abs=1e-3))
    assert outcome.error == outcome.bound == e


def test_a_run_that_stayed_inside_has_outcome_ok():
    done = run(radius=10.0)
    assert done.outcome == run(radius=10.0, outside="raise").outcome
    assert done.outcome.ok
    assert int(done.tally.violations) == 0


def test_a_run_without_an_envelope_has_outcome_ok():
    done = simulate(SMOOTH_PLANT, RINGING, STILL, PUSHED, t1=1.0, period=PERIOD, outside="recover")
    assert done.outcome.ok


def test_the_first_sample_outside_ends_a_run_without_recovery():
    done = run(outside="raise")
    assert done.outcome.kind == "left_envelope"
    assert done.outcome.t == came_back().outcome.t
    assert done.log.t[-1] == pytest.approx(done.outcome.t - PERIOD)
    assert int(done.tally.violations) == 1
    assert "shorten the period" in done.outcome.message


def test_a_recovered_run_raises_on_request():
    with pytest.raises(OutcomeError, match="was back for good") as caught:
        run(throw=True)
    assert caught.value.outcome == came_back().outcome


@pytest.mark.parametrize("log_every", [1, None])
def test_the_message_for_a_continuous_law_outside_recommends_the_sampled_data_form(log_every):
    extra = {"t1": 10.0, "period": 1e-3, "log_every": log_every}
    done = simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, outside="recover", **extra)
    outcome = done.outcome
    assert (outcome.kind, outcome.joint) == ("not_finite", 1)
    assert "It was outside its envelope, where the law is not defined: use its sampled-data form." in outcome.message
    # The count is that of `raise`: the sample that left.
    assert int(done.tally.violations) == 1
    assert outcome.t == simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, **extra).outcome.t
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((done.log, done.tally, done.state)))


@pytest.mark.parametrize("radius", [10.0, 0.1])
def test_a_law_that_fails_inside_is_not_reported_as_outside(radius):
    """An earlier excursion and return do not change this."""
    broken = Breaks(RINGING, jnp.asarray(2.5), 2)
    assert came_back().outcome.back < 2.5
    done = run(radius=radius, law=broken)
    assert (done.outcome.kind, done.outcome.joint, done.outcome.t) == ("not_finite", 2, pytest.approx(2.5))
    assert "Shorten the period, or lower the gains" in done.outcome.message
    assert int(done.tally.violations) == (int(came_back().tally.violations) if radius == 0.1 else 0)


def test_a_batch_reports_for_each_run_when_it_was_outside():
    radii = jnp.array([0.05, 0.1, 10.0])
    many = jax.jit(jax.vmap(lambda radius: run(radius)))(radii)
    for i, radius in enumerate(radii):
        single = run(radius)
        for name in ("first", "last", "joint", "outside"):
            assert getattr(many.excursion, name)[i] == getattr(single.excursion, name)
        np.testing.assert_allclose(many.excursion.beyond[i], single.excursion.beyond, atol=1e-12)
        assert many.tally.violations[i] == single.tally.violations
    assert many.excursion.first[2] == -1
