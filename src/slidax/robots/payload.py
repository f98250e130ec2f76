"""The payload at an arm's tip."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax._errors import DefinitionError
from slidax.parts import AbstractPart, Scalar, as_array, is_traced, known, parameter, require


def _moments(value: Any) -> Array:
    """Convert one number to equal moments about every axis, as of a ball."""
    moments = as_array(value)
    if moments.shape not in ((), (3, 3)):
        raise DefinitionError(f"`Payload.inertia` must be one number or 3 x 3; got {list(moments.shape)}")
    return moments if moments.shape else moments * jnp.eye(3)


class Payload(AbstractPart):
    """A rigid body held by the tip, in the tip's frame; a mass of 0 is no payload."""

    mass: Scalar = parameter("mass", "kg", ">= 0", default=0.0)
    center: Float[Array, "3"] = parameter("centre of mass", "m", default=(0.0, 0.0, 0.0))
    inertia: Float[Array, "3 3"] = parameter(
        "inertia about the centre of mass, or one number for a ball", "kg m²", default=0.0, converter=_moments
    )

    def __check_init__(self) -> None:
        inertia = known(self.inertia)
        if is_traced(inertia) or not np.isfinite(inertia).all():
            return
        scale = np.abs(inertia).max()
        require(self, "inertia", np.allclose(inertia, inertia.T, rtol=0, atol=1e-12 * scale), "must be symmetric")
        require(self, "inertia", np.linalg.eigvalsh(inertia).min() >= -1e-12 * scale, "must have moments >= 0")
        require(self, "mass", scale == 0 or known(self.mass) > 0, "must be > 0 kg where there is inertia", finite=False)

    def times(self, share: Scalar) -> Payload:
        """Return the body with mass and inertia times a factor: 0 for nothing, 1 for all of it."""
        return Payload(mass=share * self.mass, center=self.center, inertia=share * self.inertia)

    def joined(self, other: Payload) -> Payload:
        """Return both payloads, in one frame, as one body."""
        mass = self.mass + other.mass
        share = other.mass / jnp.where(mass > 0, mass, 1.0)
        between = other.center - self.center
        square = jnp.sum(between * between) * jnp.eye(3) - between[:, None] * between[None]
        return Payload(
            mass=mass,
            center=self.center + share * between,
            inertia=self.inertia + other.inertia + self.mass * share * square,
        )
