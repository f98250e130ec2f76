"""Which parts of the arguments of a function with its own derivative are differentiated."""

from __future__ import annotations

from typing import Any

import jax


def tangent_mask(primals: Any, tangents: Any) -> Any:
    """A tree of bools like `primals`: whether each leaf has a tangent. Those that are constant come as None.

    - `primals`: any pytree.
    - `tangents`: the tree that `eqx.filter_custom_jvp` gives with it.
    """
    return jax.tree.map(lambda p, d: d is not None, primals, tangents, is_leaf=lambda x: x is None)
