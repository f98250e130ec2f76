"""Where a run was outside its envelope, if it went on there."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax._types import Envelope, Scalar, Vector


class Excursion(eqx.Module):
    """The samples at or outside the bounds, as arrays.

    - `first`, `last`: number of the first and of the last such sample; -1 if there is none.
    - `joint`, `error`, `bound`: at the first, the joint that is farthest outside, from 0, its error and its bound.
    - `beyond`: by how much each joint was outside at the worst [n], rad or m; 0 if it never was.
    - `outside`: whether the latest sample was.
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
        """No such sample.

        - `joints`: number of joints.
        """
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
        """The same with one more sample.

        - `k`: number of the sample.
        - `e`: error [n], rad or m.
        - `envelope`: the bounds.
        """
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
