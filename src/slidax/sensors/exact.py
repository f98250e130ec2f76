"""A sensor without errors."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax.parts import Scalar, State

from .sensor import AbstractSensor, Measurement


class Exact(AbstractSensor):
    """The state itself, at once and always."""

    title = "A sensor without errors."

    def init(self, state: State) -> tuple[()]:
        return ()

    def __call__(
        self, k: Int[Array, ""], state: State, period: Scalar, memory: tuple[()]
    ) -> tuple[Measurement, tuple[()]]:
        return Measurement(state=state, fresh=jnp.asarray(True)), ()
