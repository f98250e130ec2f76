"""What compiled code for a closed loop depends on: everything but the numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np


@dataclass(frozen=True)
class LoopSignature:
    """The tree, the shapes and the static parts of a loop, without its numbers: loops with equal signatures share code.

    Made by `LoopSignature.of`.
    """

    tree: Any
    shapes: tuple[tuple[tuple[int, ...], str], ...]
    static_tree: Any
    static: tuple[Any, ...]
    logged: bool

    @staticmethod
    def of(arrays: Any, static: Any, logged: bool) -> LoopSignature:
        """That of a loop.

        - `arrays`, `static`: its two parts, by `equinox.partition`.
        - `logged`: whether its samples are logged.
        """
        leaves, tree = jax.tree.flatten(arrays)
        others, static_tree = jax.tree.flatten(static)
        return LoopSignature(tree, tuple((x.shape, x.dtype.name) for x in leaves), static_tree, tuple(others), logged)

    @property
    def arrays(self) -> Any:
        """Shapes in place of the arrays."""
        shapes = [jax.ShapeDtypeStruct(shape, np.dtype(name)) for shape, name in self.shapes]
        return jax.tree.unflatten(self.tree, shapes)

    @property
    def whole(self) -> Callable[[Any], Any]:
        """A function that joins arrays and static parts again."""
        static = jax.tree.unflatten(self.static_tree, self.static)
        return lambda given: eqx.combine(given, static)
