"""Selection between pytrees, the compiler's optimization barrier, and the check for 64-bit numbers."""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .errors import DefinitionError

Tree = TypeVar("Tree")


def barrier(x: Tree) -> Tree:
    """Return a pytree unchanged, but with an optimization barrier that makes XLA compute it only once.

    Otherwise XLA repeats operations that it considers cheap, such as sines and cosines, wherever `x` is used.

    - `x`: any pytree of arrays.
    """
    return jax.tree.map(jax.lax.optimization_barrier, x)


def select(condition: Bool[Array, ""], yes: Tree, no: Tree) -> Tree:
    """Return one of two pytrees with equal structure, by a condition; a leaf that is in both costs nothing.

    - `condition`: True for `yes`; its value may be unknown until run time.
    - `yes`, `no`: pytrees of arrays.
    """
    return jax.tree.map(lambda a, b: a if a is b else jnp.where(condition, a, b), yes, no)


def require_64_bits() -> None:
    """Raise DefinitionError if JAX computes with 32-bit numbers."""
    if not jax.config.read("jax_enable_x64"):
        raise DefinitionError(
            "slidax needs 64-bit numbers: import slidax before JAX makes its first array, or call "
            'jax.config.update("jax_enable_x64", True)'
        )
