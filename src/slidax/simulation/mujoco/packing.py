"""A tree of arrays as few arrays: a function is called the faster the fewer it takes."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

Packed = tuple[Any, ...]
"""All real numbers in one array, and the other arrays after it."""


class Packing:
    """Where each array of a tree is among the packed ones.

    - `shapes`: the tree, with anything that has shape and dtype for arrays.
    """

    def __init__(self, shapes: Any) -> None:
        leaves, self._tree = jax.tree.flatten(shapes)
        self._real = [np.issubdtype(leaf.dtype, np.floating) for leaf in leaves]
        self._shapes = [leaf.shape for leaf in leaves]
        sizes = [int(np.prod(leaf.shape)) for leaf, real in zip(leaves, self._real, strict=True) if real]
        self._ends = np.cumsum(sizes).tolist()

    def pack(self, tree: Any) -> Packed:
        """The packed arrays.

        - `tree`: of JAX's arrays.
        """
        leaves = list(zip(jax.tree.leaves(tree), self._real, strict=True))
        numbers = jnp.concatenate([jnp.ravel(leaf) for leaf, real in leaves if real])
        return numbers, *(leaf for leaf, real in leaves if not real)

    def unpack(self, packed: Packed) -> Any:
        """The tree.

        - `packed`: JAX's arrays or NumPy's, also with more axes in front.
        """
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
