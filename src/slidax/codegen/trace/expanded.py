"""Primitives that JAX itself expands into others."""

from __future__ import annotations

from typing import Any

import jax

from slidax.codegen.builder import Builder, Values

from .arrays import Inline, of_numbers


def expand(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Inline the expansion of a primitive: `jnp.searchsorted` is a bisection, `custom_root` is its solver."""
    primitive = equation.params["_prim"]
    shapes = [jax.ShapeDtypeStruct(atom.aval.shape, atom.aval.dtype) for atom in equation.invars]

    def written(*flat: Any) -> list[Any]:
        return jax.tree.leaves(primitive.expand(*jax.tree.unflatten(primitive.in_tree, flat)))

    return inline(jax.make_jaxpr(written)(*shapes), arrays)


def linear_solve(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Rule of `lax.custom_linear_solve`: its solver; its other functions are for derivatives."""
    lengths, jaxprs = equation.params["const_lengths"], equation.params["jaxprs"]
    first = lengths.matvec + lengths.vecmat
    right_sides = arrays[sum(lengths) :]
    return inline(jaxprs.solve, [*arrays[first : first + lengths.solve], *right_sides])


def platform_index(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    """Rule of `lax.platform_dependent`: the version for the CPU, else the default one."""
    platforms = equation.params["platforms"]
    named = [k for k, names in enumerate(platforms) if names is not None and "cpu" in names]
    number = named[0] if named else platforms.index(None)
    return of_numbers(b, jax.numpy.int32(number))
