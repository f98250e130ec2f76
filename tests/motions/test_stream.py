"""The filter of streamed positions: its poles, its lag, its limits and its motion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.motions import Streamed, StreamFilter

H = 1e-3
LIMITS = {"velocity": 1.5, "acceleration": 5.0}


def fitting(bandwidth=30.0, period=H, **options):
    return StreamFilter.fitting(bandwidth=bandwidth, period=period, **LIMITS | options)


def states(stream, targets, start):
    """Positions, velocities and accelerations at all samples [3 k n], by the filter's own step."""
    step = eqx.filter_jit(lambda state, target: stream.step(state, target, jnp.ones(()))[::2])
    state, rows = stream.begin(jnp.asarray(start)), []
    for target in targets:
        now, state = step(state, jnp.asarray(target))
        rows.append([now.q, now.dq, now.ddq])
    return np.array(rows).swapaxes(0, 1)


def test_poles_of_the_sampled_filter_are_those_of_the_bandwidth():
    stream = fitting(bandwidth=40.0, velocity=1e3, acceleration=1e6)
    start = stream.begin(jnp.zeros(1))

    def after(x):
        state = start._replace(q=x[:1], dq=x[1:2], ddq=x[2:])
        following = stream.step(state, jnp.zeros(1), jnp.ones(()))[2]
        return jnp.concatenate([following.q, following.dq, following.ddq])

    matrix = np.asarray(jax.jacobian(after)(jnp.array([1e-3, 0.0, 0.0])))
    pole = np.exp(-40.0 * H)
    assert np.poly(matrix) == pytest.approx([1.0, -3 * pole, 3 * pole**2, -(pole**3)], rel=1e-9)


@pytest.mark.parametrize(("rate", "speed"), [(None, 0.2), (50.0, 0.2), (None, 1.0)])
def test_a_constant_velocity_is_followed_with_the_computed_lag(rate, speed):
    stream = fitting(rate=rate)
    t = np.arange(0.0, 4.0, H if rate is None else 1.0 / rate)
    motion = Streamed.through(t, speed * t[:, None], stream)
    lag = float(stream.lag(speed))
    if speed == 0.2:
        assert lag == pytest.approx(3.0 / 30.0 + 0.5 * H + (0.0 if rate is None else 1.0 / rate - H), rel=1e-4)
    assert float(motion.position(jnp.asarray(3.8))[0]) == pytest.approx(
        speed * (3.8 - lag), abs=1e-5 if speed == 1.0 else 1e-9
    )
    assert float(motion.reference(jnp.asarray(3.8)).dq[0]) == pytest.approx(speed, rel=1e-4)


def random_stream(rng, joints=3, count=4000):
    """A filter with random limits, and a stream that jumps to the ends of a range and into it at random times."""
    h = 10 ** rng.uniform(-3.3, -2)
    w = np.minimum(10 ** rng.uniform(0, 2.3, joints), 0.5 / h)
    v = 10 ** rng.uniform(-1, 1, joints)
    a = v * w * 10 ** rng.uniform(-1.5, 1, joints)
    j = np.minimum(w * a * 10 ** rng.uniform(0, 1, joints), 2.0 * a / h)
    upper = 10 ** rng.uniform(-3, 1.5, joints) * v / w
    stream = StreamFilter.fitting(
        bandwidth=w, velocity=v, acceleration=a, jerk=j, period=h, lower=np.zeros(joints), upper=upper
    )
    ends = rng.choice([-1.0, 0.0, 1.0, 2.0], (count, joints))
    targets = upper * np.where(rng.random((count, joints)) < 0.5, ends, rng.random((count, joints)))
    last = np.maximum.accumulate(np.where(rng.random(count) < 10 ** rng.uniform(-3, -0.5), np.arange(count), 0))
    return stream, h * np.arange(count), targets[last]


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(seed, marks=pytest.mark.full) for seed in range(3, 60))])
def test_no_stream_drives_the_motion_beyond_its_limits(seed):
    stream, t, targets = random_stream(np.random.default_rng(seed))
    targets[0] = np.clip(targets[0], 0.0, stream.upper)
    motion = Streamed.through(t, targets, stream)
    # The polynomials' extremes hold at every time, not only at the samples.
    for order, bound in enumerate((stream.velocity, stream.acceleration, stream.jerk), start=1):
        assert (motion.extremes(order).size <= np.asarray(bound) * (1 + 1e-9)).all()
    reach, slack = motion.extremes(0), 1e-9 * np.asarray(stream.upper)
    assert (reach.least >= -slack).all() and (reach.largest <= stream.upper + slack).all()
    assert np.asarray(motion.position(motion.until)) == pytest.approx(
        np.clip(targets[-1], 0.0, stream.upper), rel=1e-6, abs=1e-9
    )


def test_lowered_limits_are_reached_without_a_jump():
    stream = fitting()
    fast = states(stream, np.full((400, 1), 5.0), np.zeros(1))
    state = stream.begin(*(jnp.asarray(part[-1]) for part in fast))
    slow = fitting(velocity=0.3)
    rows = []
    for _ in range(1500):
        _, following, state = slow.step(state, jnp.full(1, 5.0), jnp.ones(()))
        rows.append([following.dq[0], following.ddq[0]])
    speed, push = np.array(rows).T
    assert fast[1, -1, 0] > 1.4 and speed[-1] == pytest.approx(0.3)
    assert np.abs(push).max() <= 5.0 + 1e-9 and np.abs(np.diff(push)).max() <= float(slow.jerk) * H * (1 + 1e-9)


def test_a_position_that_is_not_finite_is_replaced_by_the_last_finite_position():
    stream, good = fitting(), np.array([0.2, -0.1])
    for bad in (np.nan, np.inf):
        both = states(stream, [good] * 20 + [[bad, -0.1]] * 300, np.zeros(2))
        assert both == pytest.approx(states(stream, [good] * 320, np.zeros(2)))


def test_interpolation_between_the_positions_of_a_slow_stream_reduces_the_jerk():
    t = np.arange(0.0, 3.0, 0.05)
    q = 0.2 * np.sin(2.0 * t)[:, None]
    held, line = (Streamed.through(t, q, fitting(rate=rate)).extremes(3).size for rate in (None, 20.0))
    assert line[0] < 0.4 * held[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bandwidth": 2000.0}, "bandwidth` must be at most 1/`period`"),
        ({"jerk": 20.0}, "at least `bandwidth \\* acceleration` = 150"),
        ({"jerk": 2e4}, "at most `2 \\* acceleration / period`"),
        ({"velocity": 0.0}, "velocity` must be > 0"),
        ({"rate": 2000.0}, "at most the law's sampling rate, 1000 Hz"),
    ],
)
def test_a_filter_that_cannot_keep_its_limits_is_refused(options, words):
    with pytest.raises(DefinitionError, match=words):
        fitting(**options)


def test_a_stream_that_starts_out_of_range_is_refused():
    with pytest.raises(DefinitionError, match="starts at 2 for joint 1, outside the joint's limits"):
        Streamed.through([0.0, 1.0], [[2.0], [0.0]], fitting(upper=1.0))


@pytest.mark.parametrize("times", [[0.0, 1.0, 0.5], [0.0, 0.5, 0.5], [-0.1, 0.0, 0.5], [0.0, 0.5, np.nan]])
def test_times_of_a_stream_must_be_increasing_and_finite_from_0_on(times):
    with pytest.raises(DefinitionError, match="times of a stream must be increasing, finite, and 0 or more"):
        Streamed.through(times, [[0.0], [0.1], [0.2]], fitting())


def test_a_recorded_stream_with_a_position_that_is_not_finite_is_refused_with_its_row():
    with pytest.raises(DefinitionError, match="must be finite; row 2 is not, for joint 1"):
        Streamed.through([0.0, 0.5, 1.0], [[0.0], [np.nan], [0.2]], fitting())


def test_a_stream_of_too_many_samples_is_refused():
    with pytest.raises(DefinitionError, match="check the unit of its times"):
        Streamed.through([0.0, 1e6], [[0.0], [0.1]], fitting())


def test_a_filter_with_an_empty_position_range_is_refused():
    with pytest.raises(DefinitionError, match=r"`StreamFilter\.upper` must be at least `lower`"):
        fitting(lower=1.0, upper=0.5)


STREAM = "time,shoulder,elbow\n0,-0.4,2.5\n0.5,-0.2,2.4\n1,0.0,2.2\n1.5,0.0,2.2\n"


def streamed(**options):
    described = {"kind": "streamed", "text": STREAM, "bandwidth": 15.0, "velocity": 2.0, "acceleration": 4.0} | options
    described["joints"] = ["shoulder", "elbow"]
    changes = {"trajectory": described, "start.q": [-0.4, 2.5], "simulation.t1": 2.0}
    return scenarios.load("example-4.1-1khz", changes)


def test_a_scenario_follows_a_stream_and_reports_its_lag():
    scenario = streamed(rate=2.0)
    assert f"{1e3 * float(scenario.trajectory.stream.lag(0.0)):.3g} ms after a slow stream" in repr(scenario)
    run = scenario.simulate()
    assert run.outcome.ok
    assert np.asarray(run.log.state.q)[-1] == pytest.approx([0.0, 2.2], abs=2e-3)


def test_torque_rate_limits_set_the_jerk_limit_of_a_stream_or_refuse_it():
    changes = {"torque": 100.0, "rate": 2000.0}
    free = streamed()
    scenario = free.set({"actuator": changes})
    mass = np.abs(np.asarray(scenario.controller.nominal.mass(jnp.array([-0.4, 2.5]))))
    assert (mass @ np.asarray(scenario.trajectory.stream.jerk)).max() == pytest.approx(1000.0)
    with pytest.raises(DefinitionError, match="lower `bandwidth` to") as refused:
        free.set({"actuator": {"torque": 100.0, "rate": 200.0}})
    words = str(refused.value)
    share = float(words.split("`acceleration` to ")[1].split(" times")[0])
    assert free.set({"trajectory.acceleration": 4.0 * share * 0.999, "actuator": {"torque": 100.0, "rate": 200.0}})
