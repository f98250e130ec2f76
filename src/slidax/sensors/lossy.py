"""A sensor whose words get lost."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from slidax._errors import DefinitionError, as_array, is_traced, known, require, require_shape
from slidax._types import Memory, Scalar, State

from .chance import LOSSY, uniform, whole
from .sensor import AbstractSensor, Measurement


class Arrived(eqx.Module):
    """The memory of `Lossy`.

    - `last`: the last state that arrived.
    - `inner`: the memory of the sensor whose samples get lost.
    """

    last: State
    inner: Memory


class Lossy(AbstractSensor):
    """What `sensor` measures, unless it is lost: by chance, and always for `start <= k < start + count`.

    Sample 0 always arrives. A lost sample is not fresh, and repeats the last that arrived; the sensor itself goes on
    measuring.

    - `sensor`: what measures.
    - `probability`: of losing a sample, for each by itself, one number in [0, 1].
    - `starts`: number of the first sample of each outage [m], whole.
    - `counts`: how many samples each outage takes [m], whole, >= 0.
    - `seed`: a whole number; another seed loses other samples.

    Raises DefinitionError if one of them is out of its range or starts and counts are not equally many.
    """

    sensor: AbstractSensor
    probability: Scalar = eqx.field(converter=as_array, default=0.0)
    starts: Int[Array, " m"] = eqx.field(converter=whole, default=())
    counts: Int[Array, " m"] = eqx.field(converter=whole, default=())
    seed: Int[Array, ""] = eqx.field(converter=whole, default=0)

    def __check_init__(self) -> None:
        require_shape(self, (), "probability", "seed")
        require(
            self, "probability", (known(self.probability) >= 0) & (known(self.probability) <= 1), "must be in [0, 1]"
        )
        if self.starts.ndim != 1 or self.starts.shape != self.counts.shape:
            raise DefinitionError(
                "`Lossy.counts` must have one entry for each of `starts`; "
                f"got shapes {list(self.counts.shape)} and {list(self.starts.shape)}"
            )
        if not is_traced(self.counts) and np.any(np.asarray(self.counts) < 0):
            raise DefinitionError(f"`Lossy.counts` must be >= 0 samples; got {int(np.min(self.counts))}")

    def init(self, state: State) -> Arrived:
        """The first state, which is never used, for sample 0 arrives.

        - `state`: true positions and velocities at sample 0.
        """
        return Arrived(last=state, inner=self.sensor.init(state))

    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: Arrived) -> tuple[Measurement, Arrived]:
        """What is measured, or the last that arrived.

        - `k`: number of the sample.
        - `state`: true positions and velocities at it.
        - `period`: time between two samples [s].
        - `memory`: with the last that arrived.
        """
        measurement, inner = self.sensor(k, state, period, memory.inner)
        by_chance = uniform(self.seed, LOSSY, k) < self.probability
        since = k.astype(self.starts.dtype) - self.starts
        by_plan = jnp.any((since >= 0) & (since < self.counts))
        fresh = measurement.fresh & ((k == 0) | ~(by_chance | by_plan))
        last = jax.tree.map(lambda new, old: jnp.where(fresh, new, old), measurement.state, memory.last)
        return Measurement(state=last, fresh=fresh), Arrived(last=last, inner=inner)
