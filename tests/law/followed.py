"""Estimates of a motion with a model of free joints, so that all acceleration is a disturbance."""

import jax
import jax.numpy as jnp

from slidax.core.types import State
from slidax.law import Estimate


def predicted(last, elapsed):
    """The prediction from the last estimate under its disturbance."""
    return Estimate(
        state=State(
            q=last.state.q + elapsed * (last.state.dq + 0.5 * elapsed * last.disturbance),
            dq=last.state.dq + elapsed * last.disturbance,
        ),
        disturbance=last.disturbance,
    )


def followed(estimator, motion, samples, period=1e-3, noise=0.0, disturbance=0.0):
    """The estimates at samples 1, 2, ..., stacked; the first measurement is at sample 0."""
    elapsed = jnp.asarray(period)
    first = motion(jnp.zeros(()))

    def sample(carry, now):
        last, memory = carry
        k, off = now
        true = motion(k.astype(float) * elapsed)
        measured = State(q=true.q + off, dq=true.dq)
        estimate, memory = estimator(measured, predicted(last, elapsed), elapsed, jnp.asarray(False), memory)
        return (estimate, memory), estimate

    start = Estimate(state=first, disturbance=jnp.full_like(first.q, disturbance))
    off = jnp.broadcast_to(jnp.asarray(noise), (samples, *first.q.shape))
    return jax.lax.scan(sample, (start, estimator.init(first)), (jnp.arange(1, samples + 1), off))[1]


def accelerated(acceleration):
    """A motion with a constant acceleration [n], which to the estimator is a disturbance."""
    speed = jnp.array([1.0, -2.0])
    return lambda t: State(q=t * (speed + 0.5 * t * acceleration), dq=speed + t * acceleration)


def swinging(t):
    """A motion whose disturbance is its position with the opposite sign."""
    return State(q=jnp.stack([jnp.sin(t), jnp.cos(t)]), dq=jnp.stack([jnp.cos(t), -jnp.sin(t)]))
