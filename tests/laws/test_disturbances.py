"""Every disturbance is a force that adds up and scales."""

import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.types import State
from slidax.plant import Constant, Samples, Scaled, Step, Sum
from tests.enrolled import assert_finite, assert_float_leaves, every
from tests.plant.disturbances.members import DISTURBANCES

rng = np.random.default_rng(0)
TIMES = jnp.asarray(rng.uniform(0.0, 3.0, 40))
STATES = jax.vmap(State)(*jnp.asarray(rng.normal(size=(2, 40, 2))))


def force(disturbance):
    return np.asarray(jax.vmap(disturbance)(TIMES, STATES))


@every("disturbance", DISTURBANCES)
def test_two_disturbances_add(disturbance):
    other = Constant([0.25, -4.0])
    np.testing.assert_allclose(force(disturbance + other), force(disturbance) + force(other), rtol=1e-15)
    np.testing.assert_allclose(force(other + disturbance), force(disturbance) + force(other), rtol=1e-15)


@every("disturbance", DISTURBANCES)
def test_a_factor_scales_a_disturbance_from_left_and_right(disturbance):
    np.testing.assert_array_equal(force(2.5 * disturbance), 2.5 * force(disturbance))
    np.testing.assert_array_equal(force(disturbance * 2.5), 2.5 * force(disturbance))
    assert np.any(force(disturbance) != 0)


@every("disturbance", DISTURBANCES)
def test_factor_zero_switches_a_disturbance_off(disturbance):
    np.testing.assert_array_equal(force(0.0 * disturbance), 0.0)


@every("disturbance", DISTURBANCES)
def test_a_disturbance_has_one_force_per_joint_and_finite_parameter_gradients(disturbance):
    state = State(q=jnp.zeros(2), dq=jnp.zeros(2))

    def total(disturbance):
        tau = disturbance(jnp.asarray(1.0), state)
        assert tau.shape == (2,)
        return jnp.sum(tau)

    assert_float_leaves(disturbance)
    assert_finite(jax.grad(total)(disturbance))


PERIOD, INSIDE = 0.05, 41


def sampled(dense):
    return Samples(PERIOD, TICKS[:-1], dense[0][:-1:INSIDE], dense[1][:-1:INSIDE])


TICKS = PERIOD * np.arange(41)
FINE = (TICKS[:-1, None] + PERIOD * np.linspace(0.0, 1.0, INSIDE)).ravel()


def moving(seed):
    """Positions and velocities [N + 1, 2] at fine times, with a constant acceleration over each period."""
    acceleration = np.random.default_rng(seed).normal(size=(len(TICKS) - 1, 2)) * 4.0
    dq = np.concatenate([np.zeros((1, 2)), np.cumsum(acceleration, axis=0) * PERIOD])
    q = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (dq[1:] + dq[:-1]) * PERIOD, axis=0)])
    k = np.repeat(np.arange(len(TICKS) - 1), INSIDE)
    s = FINE - TICKS[k]
    fine = q[k] + dq[k] * s[:, None] + 0.5 * acceleration[k] * s[:, None] ** 2, dq[k] + acceleration[k] * s[:, None]
    return tuple(np.concatenate([part, last[-1:]]) for part, last in zip(fine, (q, dq), strict=True))


def off_the_chord(disturbance, dense):
    """Distance of the force from the line between two samples [N 2]."""
    q, dq = (jnp.asarray(part[:-1]) for part in dense)
    tau = np.asarray(jax.vmap(lambda t, q, dq: disturbance(t, State(q=q, dq=dq)))(jnp.asarray(FINE), q, dq))
    tau = tau.reshape(len(TICKS) - 1, INSIDE, 2)
    share = np.linspace(0.0, 1.0, INSIDE)[:, None]
    return np.abs(tau - (tau[:, :1] + share * (tau[:, -1:] - tau[:, :1]))).max(axis=1)


def between(disturbance, other):
    lower, upper = (jax.tree.map(end, disturbance, other) for end in (jnp.minimum, jnp.maximum))
    return lower, upper


@every("disturbance", DISTURBANCES)
def test_chord_deviation_bounds_the_force_between_samples_for_a_box_of_parameters(disturbance):
    random = np.random.default_rng(4)
    other = jax.tree.map(lambda leaf: leaf * random.uniform(0.5, 2.0, leaf.shape), disturbance)
    lower, upper = between(disturbance, other)
    for seed in range(6):
        dense = moving(seed)
        bound = lower.chord_deviation(upper, sampled(dense))
        assert np.isfinite(bound).all()
        part = jax.tree.map(lambda low, high: low + (high - low) * random.uniform(size=low.shape), lower, upper)
        assert (off_the_chord(part, dense) <= bound + 1e-12)[:-1].all()


@every("disturbance", DISTURBANCES)
def test_chord_deviation_adds_up_over_equal_terms_and_grows_with_the_box(disturbance):
    dense = moving(1)
    samples = sampled(dense)
    whole = disturbance.chord_deviation(disturbance, samples)
    parts = Sum((Scaled(disturbance, 0.25),) * 4)
    np.testing.assert_allclose(parts.chord_deviation(parts, samples), whole, rtol=1e-12)
    _, upper = between(disturbance, jax.tree.map(lambda leaf: 1.5 * leaf, disturbance))
    assert (disturbance.chord_deviation(upper, samples) >= whole - 1e-12).all()


def test_a_short_pulse_has_a_breakpoint_inside():
    random = np.random.default_rng(7)
    for start, length in zip(random.uniform(0, 2, 20), 10 ** random.uniform(-6, -1, 20), strict=True):
        pulse = Scaled(Sum((Constant([1.0, 1.0]), Step([3.0, -1.0], start, start + length))), -2.0)
        inside = [time for time in pulse.breakpoints() if start <= time < start + length]
        assert inside
        state = State(q=jnp.zeros(2), dq=jnp.zeros(2))
        assert np.any(np.asarray(pulse(jnp.asarray(inside[0]), state)) != np.asarray(pulse(jnp.asarray(5.0), state)))
