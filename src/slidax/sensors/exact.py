"""A sensor without any fault."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax.parts import Scalar, State

from .sensor import AbstractSensor, Measurement


class Exact(AbstractSensor):
    """The state itself, at once and always."""

    title = "A sensor without any fault."

    def init(self, state: State) -> tuple[()]:
        """Nothing to keep.

        - `state`: true positions and velocities at sample 0.
        """
        return ()

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: tuple[()]
    ) -> tuple[Measurement, tuple[()]]:
        """The true state.

        - `k`: number of the sample.
        - `state`: true positions and velocities at it.
        - `period`: time between two samples [s].
        - `memory`: empty.
        """
        return Measurement(state=state, fresh=jnp.asarray(True)), ()
