"""Signature of a closed loop: its tree, shapes and static parts, without its values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np


@dataclass(frozen=True)
class LoopSignature:
    """Key of compiled code: loops with equal signatures share it."""

    tree: Any
    shapes: tuple[tuple[tuple[int, ...], str], ...]
    static_tree: Any
    static: tuple[Any, ...]
    logged: bool

    @staticmethod
    def of(arrays: Any, static: Any, logged: bool) -> LoopSignature:
        """Return the signature of a tree from its two halves, as `equinox.partition` gives them."""
        leaves, tree = jax.tree.flatten(arrays)
        others, static_tree = jax.tree.flatten(static)
        return LoopSignature(tree, tuple((x.shape, x.dtype.name) for x in leaves), static_tree, tuple(others), logged)

    @property
    def arrays(self) -> Any:
        """Shapes in place of the arrays."""
        shapes = [jax.ShapeDtypeStruct(shape, np.dtype(name)) for shape, name in self.shapes]
        return jax.tree.unflatten(self.tree, shapes)

    @property
    def join(self) -> Callable[[Any], Any]:
        """Function that joins arrays with the static parts."""
        static = jax.tree.unflatten(self.static_tree, self.static)
        return lambda arrays: eqx.combine(arrays, static)
