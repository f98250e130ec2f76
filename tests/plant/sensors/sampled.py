"""Measurements of a motion by a sensor."""

import jax
import jax.numpy as jnp

from slidax.core.types import State


def moving(t):
    """A smooth motion of two joints."""
    return State(q=jnp.stack([jnp.sin(3.0 * t), 0.5 - t]), dq=jnp.stack([3.0 * jnp.cos(3.0 * t), -jnp.ones_like(t)]))


def sampled(sensor, motion=moving, samples=12, period=1e-2):
    """The measurements at samples 0, 1, ..., stacked."""

    def sample(memory, k):
        measurement, memory = sensor(k, motion(k.astype(float) * period), jnp.asarray(period), memory)
        return memory, measurement

    return jax.lax.scan(sample, sensor.init(motion(jnp.zeros(()))), jnp.arange(samples))[1]
