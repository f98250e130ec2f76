"""Positions as a robot's own log has them: measured, and when they arrived."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from slidax.sensors import AbstractSensor


def as_measured(
    sensor: AbstractSensor | None, q: np.ndarray, dq: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """The positions that a sensor gives at each sample [N n], and whether they arrived [N].

    A simulated log has the true state; the law had this. The same seed gives the same noise as in the run.

    - `sensor`: the run's; None for a perfect one.
    - `q`, `dq`: true positions and velocities [N n], from sample 0 on.
    - `period`: h [s].
    """
    if sensor is None:
        return q, np.ones(len(q), bool)

    def measure(memory: Any, sample: Any) -> Any:
        k, q, dq = sample
        measured, memory = sensor(k, State(q=q, dq=dq), jnp.asarray(period), memory)
        return memory, (measured.state.q, measured.fresh)

    @jax.jit
    def all_of(q: Any, dq: Any) -> Any:
        first = sensor.init(State(q=q[0], dq=dq[0]))
        return jax.lax.scan(measure, first, (jnp.arange(len(q)), q, dq))[1]

    positions, fresh = all_of(jnp.asarray(q), jnp.asarray(dq))
    return np.asarray(positions), np.asarray(fresh)
