"""What an arm carries at its tip."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax._errors import DefinitionError, as_array, is_traced, known, require, require_shape
from slidax._types import Scalar


def _moments(value: Any) -> Array:
    """A converter: one number stands for the same moment about every axis, as of a ball."""
    given = as_array(value)
    return given * jnp.eye(3) if given.shape == () else given


class Payload(eqx.Module):
    """A rigid body that is held by the tip, in the tip's frame.

    - `mass`: kg, >= 0; 0 is no payload.
    - `center`: its centre of mass [3], m.
    - `inertia`: about its centre of mass [3 3], or one number for a ball, kg m², positive semi-definite.

    Raises DefinitionError if one of them is out of its range.
    """

    mass: Scalar = eqx.field(converter=as_array, default=0.0)
    center: Float[Array, "3"] = eqx.field(converter=as_array, default=(0.0, 0.0, 0.0))
    inertia: Float[Array, "3 3"] = eqx.field(converter=_moments, default=0.0)

    def __check_init__(self) -> None:
        require_shape(self, (), "mass")
        require_shape(self, (3,), "center")
        if np.shape(self.inertia) != (3, 3):
            raise DefinitionError(f"`Payload.inertia` must be one number or 3 x 3; got {list(np.shape(self.inertia))}")
        require(self, "mass", known(self.mass) >= 0, "must be >= 0 kg")
        require(self, "center", True, "must be finite")
        if is_traced(self.inertia):
            return
        inertia = known(self.inertia)
        scale = np.abs(inertia).max()
        require(self, "inertia", np.isfinite(inertia).all(), "must be finite")
        require(self, "inertia", np.allclose(inertia, inertia.T, rtol=0, atol=1e-12 * scale), "must be symmetric")
        require(self, "inertia", np.linalg.eigvalsh(inertia).min() >= -1e-12 * scale, "must have moments >= 0")
        require(self, "mass", scale == 0 or known(self.mass) > 0, "must be > 0 kg where there is inertia")

    def times(self, share: Scalar) -> Payload:
        """The same body with another density: mass and inertia times a factor.

        - `share`: 0 for nothing, 1 for all of it.
        """
        return Payload(mass=share * self.mass, center=self.center, inertia=share * self.inertia)

    def joined(self, other: Payload) -> Payload:
        """Both as one body.

        - `other`: in the same frame.
        """
        mass = self.mass + other.mass
        share = other.mass / jnp.where(mass > 0, mass, 1.0)
        between = other.center - self.center
        square = jnp.sum(between * between) * jnp.eye(3) - between[:, None] * between[None]
        return Payload(
            mass=mass,
            center=self.center + share * between,
            inertia=self.inertia + other.inertia + self.mass * share * square,
        )
