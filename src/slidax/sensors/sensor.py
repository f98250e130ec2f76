"""Base class of the sensors, and the measurement."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Bool, Int

from slidax.parts import AbstractPart, Memory, Scalar, State


class Measurement(eqx.Module):
    """Measurement at one sample.

    - `state`: measured positions and velocities.
    - `fresh`: False if this sample was lost; `state` is then the last that arrived.
    """

    state: State
    fresh: Bool[Array, ""]


class AbstractSensor(AbstractPart):
    """Map from the true state at a sample to a measurement.

    Pure: random numbers depend on a seed and the sample's number only. Call a sensor at every sample, in order, from
    number 0 on.
    """

    @abstractmethod
    def init(self, state: State) -> Memory:
        """Sensor state before the first sample: any pytree of arrays, also an empty one.

        - `state`: true positions and velocities at sample 0.
        """

    @abstractmethod
    def __call__(self, k: Int[Array, ""], state: State, period: Scalar, memory: Memory) -> tuple[Measurement, Memory]:
        """The measurement at sample k, and the memory after it, a tree like `memory`.

        - `k`: number of the sample, from 0 on.
        - `state`: true positions and velocities at sample k.
        - `period`: time between two samples [s], > 0.
        - `memory`: what `init` returned, or the call at the last sample.
        """
