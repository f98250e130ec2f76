"""A compiler hint against repeated computation."""

from __future__ import annotations

from typing import TypeVar

import jax

Tree = TypeVar("Tree")


def once(x: Tree) -> Tree:
    """Compute `x` once. XLA repeats operations that it considers cheap, also sines and cosines, in every consumer.

    - `x`: any pytree of arrays.
    """
    return jax.tree.map(jax.lax.optimization_barrier, x)
