"""How large the uncertainty can be, as far as the state tells."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import as_array, known, require, require_shape
from slidax._types import Scalar, State
from slidax.numerics import vector_norm


class StateBound(eqx.Module):
    """`b0 + b1‖q‖ + b2‖q̇‖²`: what (19) bounds the lumped uncertainty by, without the share of the torque.

    - `constant`, `position`, `velocity`: b0 [N m], b1 [N m/rad], b2 [N m s²/rad²], >= 0.

    Raises DefinitionError if one of them is negative.
    """

    constant: Scalar = eqx.field(converter=as_array)
    position: Scalar = eqx.field(converter=as_array)
    velocity: Scalar = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        require_shape(self, (), "constant", "position", "velocity")
        for field, symbol in (("constant", "b0"), ("position", "b1"), ("velocity", "b2")):
            require(self, field, known(getattr(self, field)) >= 0, f"must be >= 0 ({symbol}, eq. 19)")

    def __call__(self, state: State) -> Scalar:
        """The bound, N m.

        - `state`: positions and velocities.
        """
        return self.constant + self.position * vector_norm(state.q) + self.velocity * jnp.sum(state.dq * state.dq)
