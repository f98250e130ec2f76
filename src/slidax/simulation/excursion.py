"""Excursion of a run outside its envelope."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax._types import Envelope, Scalar, Vector


class Excursion(eqx.Module):
    """The samples at or outside the bounds, as arrays.

    - `first`, `last`: numbers of the first and the last such sample; -1 without one.
    - `joint`, `error`, `bound`: of the joint farthest outside at the first such sample; `joint` counts from 0.
    - `beyond`: each joint's largest distance outside [n], rad or m; 0 if always inside.
    - `outside`: True if the latest sample was outside.
    """

    first: Int[Array, ""]
    last: Int[Array, ""]
    joint: Int[Array, ""]
    error: Scalar
    bound: Scalar
    beyond: Vector
    outside: Bool[Array, ""]

    @staticmethod
    def none(joints: int) -> Excursion:
        """Return the excursion of a run that never left its envelope."""
        never, zero = jnp.full((), -1), jnp.zeros(())
        return Excursion(
            first=never,
            last=never,
            joint=jnp.zeros((), int),
            error=zero,
            bound=zero,
            beyond=jnp.zeros(joints),
            outside=jnp.zeros((), bool),
        )

    def add(self, k: Int[Array, ""], e: Vector, envelope: Envelope) -> Excursion:
        """Add sample k with error e [n], rad or m."""
        over = jnp.maximum(e - envelope.upper, envelope.lower - e)
        outside = jnp.any(over >= 0)
        joint = jnp.argmax(over)
        first = outside & (self.first < 0)
        bound = jnp.where(e >= envelope.upper, envelope.upper, envelope.lower)
        return Excursion(
            first=jnp.where(first, k, self.first),
            last=jnp.where(outside, k, self.last),
            joint=jnp.where(first, joint, self.joint),
            error=jnp.where(first, e[joint], self.error),
            bound=jnp.where(first, bound[joint], self.bound),
            beyond=jnp.maximum(self.beyond, over),
            outside=outside,
        )
