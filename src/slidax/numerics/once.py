"""A hint to the compiler."""

from __future__ import annotations

from typing import TypeVar

import jax

Tree = TypeVar("Tree")


def once(x: Tree) -> Tree:
    """`x`, computed in one place. XLA repeats what it considers cheap, sines and cosines too, in every consumer.

    - `x`: any pytree of arrays.
    """
    return jax.tree.map(jax.lax.optimization_barrier, x)
