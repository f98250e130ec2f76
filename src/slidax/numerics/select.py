"""A choice between two trees of arrays."""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

Tree = TypeVar("Tree")


def select(condition: Bool[Array, ""], yes: Tree, no: Tree) -> Tree:
    """Return one of two trees of the same structure; a leaf that both share costs nothing.

    - `condition`: True for `yes`.
    - `yes`, `no`: pytrees of arrays.
    """
    return jax.tree.map(lambda a, b: a if a is b else jnp.where(condition, a, b), yes, no)
