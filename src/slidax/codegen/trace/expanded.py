"""Primitives that JAX itself writes in others."""

from __future__ import annotations

from typing import Any

import jax

from slidax.codegen.builder import Builder, Values

from .blocks import Inline


def expanded(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """What such a primitive is written in, as `jnp.searchsorted` is in a search by halves."""
    primitive = equation.params["_prim"]
    shapes = [jax.ShapeDtypeStruct(atom.aval.shape, atom.aval.dtype) for atom in equation.invars]
    return inline(jax.make_jaxpr(lambda *args: jax.tree.leaves(primitive.expand(*args)))(*shapes), arrays)
