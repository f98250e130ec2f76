"""Ranges of parameters, checked where they are set at run time."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.parts import AbstractPart, Parameter
from slidax.parts.parameter import declared, is_declared

from .step_memory import Flag


def parameters_valid(tree: Any) -> Flag:
    """True if every parameter in a tree of parts is finite and in the range that it declares.

    An infinite number is valid only where the range ends with `inf]` or begins with `[-inf`. Numbers without a
    declaration must be finite.

    - `tree`: a part, or a module with parts.
    """
    conditions = [jnp.all(condition) for condition in _conditions(tree)]
    return jnp.all(jnp.stack(conditions)) if conditions else jnp.ones((), bool)


def _conditions(tree: Any) -> Iterator[Any]:
    if isinstance(tree, eqx.Module):
        for field in dataclasses.fields(tree):
            value = getattr(tree, field.name)
            if field.metadata.get("static", False) or value is None:
                continue
            if isinstance(tree, AbstractPart) and is_declared(field) and eqx.is_array(value):
                yield _in_range(tree, declared(field), value)
            else:
                yield from _conditions(value)
        return
    for leaf in jax.tree.leaves(tree, is_leaf=lambda node: isinstance(node, eqx.Module)):
        if isinstance(leaf, eqx.Module):
            yield from _conditions(leaf)
        elif eqx.is_inexact_array(leaf):
            yield jnp.isfinite(leaf)


def _in_range(part: AbstractPart, parameter: Parameter, value: Any) -> Any:
    if not jnp.issubdtype(jnp.asarray(value).dtype, jnp.inexact):
        return jnp.ones((), bool)
    lower, upper = parameter.range.ends
    low, high = lower.traced(part), upper.traced(part)
    above = value > low if lower.open else value >= low
    inside = above & (value < high if upper.open else value <= high)
    endless = any(end.number is not None and np.isinf(end.number) and not end.open for end in (lower, upper))
    return inside if endless else inside & jnp.isfinite(value)
