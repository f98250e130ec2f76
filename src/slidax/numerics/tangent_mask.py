"""Find the differentiated arguments of a function with a custom derivative."""

from __future__ import annotations

from typing import Any

import jax


def tangent_mask(primals: Any, tangents: Any) -> Any:
    """A tree of bools like `primals`, True for each leaf with a tangent.

    - `tangents`: from `eqx.filter_custom_jvp`, with None for constants.
    """
    return jax.tree.map(lambda p, d: d is not None, primals, tangents, is_leaf=lambda x: x is None)
