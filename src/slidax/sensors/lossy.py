"""A sensor that loses samples."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax.parts import DefinitionError, Memory, Scalar, State, parameter, piece

from .chance import LOSSY, seed, uniform, whole
from .sensor import AbstractSensor, Measurement


class Arrived(eqx.Module):
    """The memory of `Lossy`.

    - `last`: the last state that arrived.
    - `inner`: the memory of the inner sensor.
    """

    last: State
    inner: Memory


class Lossy(AbstractSensor):
    """Measurement of `sensor`, lost at random, and always for `start <= k < start + count`.

    Sample 0 always arrives. A lost sample is not fresh, and repeats the last sample that arrived. The sensor goes on
    measuring.
    """

    sensor: AbstractSensor = piece("what measures")
    probability: Scalar = parameter("of losing a sample, for each by itself", "", "[0, 1]", default=0.0)
    starts: Int[Array, " m"] = parameter("number of the first sample of each outage", default=(), converter=whole)
    counts: Int[Array, " m"] = parameter(
        "how many samples each outage takes", "samples", ">= 0", default=(), converter=whole
    )
    seed: Int[Array, ""] = seed("losses")

    def __check_init__(self) -> None:
        if self.starts.ndim != 1 or self.starts.shape != self.counts.shape:
            raise DefinitionError(
                "`Lossy.counts` must have one entry for each of `starts`; "
                f"got shapes {list(self.counts.shape)} and {list(self.starts.shape)}"
            )

    def init(self, state: State) -> Arrived:
        """The first state, which is never used, for sample 0 arrives."""
        return Arrived(last=state, inner=self.sensor.init(state))

    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: Arrived) -> tuple[Measurement, Arrived]:
        """Measurement at sample k, or the last one that arrived."""
        measurement, inner = self.sensor(k, state, period, memory.inner)
        by_chance = uniform(self.seed, LOSSY, k) < self.probability
        since = k.astype(self.starts.dtype) - self.starts
        by_plan = jnp.any((since >= 0) & (since < self.counts))
        fresh = measurement.fresh & ((k == 0) | ~(by_chance | by_plan))
        last = jax.tree.map(lambda new, old: jnp.where(fresh, new, old), measurement.state, memory.last)
        return Measurement(state=last, fresh=fresh), Arrived(last=last, inner=inner)
