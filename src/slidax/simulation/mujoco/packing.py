"""A tree of arrays as few arrays, since calls with fewer arguments are faster."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

Packed = tuple[Any, ...]
"""All floating-point values in one array, then the other arrays."""


class Packing:
    """Layout of a tree in packed arrays.

    - `shapes`: the tree, with objects that have shape and dtype for arrays.
    """

    def __init__(self, shapes: Any) -> None:
        leaves, self._tree = jax.tree.flatten(shapes)
        self._real = [np.issubdtype(leaf.dtype, np.floating) for leaf in leaves]
        self._shapes = [leaf.shape for leaf in leaves]
        sizes = [int(np.prod(leaf.shape)) for leaf, real in zip(leaves, self._real, strict=True) if real]
        self._ends = np.cumsum(sizes).tolist()

    def pack(self, tree: Any) -> Packed:
        leaves = list(zip(jax.tree.leaves(tree), self._real, strict=True))
        numbers = jnp.concatenate([jnp.ravel(leaf) for leaf, real in leaves if real])
        return numbers, *(leaf for leaf, real in leaves if not real)

    def unpack(self, packed: Packed) -> Any:
        """Return the tree; the packed arrays may have more axes in front."""
        numbers, *others = packed
        starts = [0, *self._ends]
        real = (numbers[..., start:end] for start, end in zip(starts, self._ends, strict=False))
        rest = iter(others)
        before = numbers.shape[:-1]
        leaves = [
            next(real).reshape((*before, *shape)) if is_real else next(rest)
            for shape, is_real in zip(self._shapes, self._real, strict=True)
        ]
        return jax.tree.unflatten(self._tree, leaves)
