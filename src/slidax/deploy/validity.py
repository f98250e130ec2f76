"""Ranges of parameters, checked where they are set at run time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from slidax.parts import AbstractPart, Parameter
from slidax.parts.parameter import declared, is_declared

from .members import way
from .step_memory import Flag


class Bounds(NamedTuple):
    """Closed bounds of the numbers of one array; infinite where the parameter may be."""

    low: float
    high: float


def constant_bounds(tree: Any, real: str) -> list[Bounds | None]:
    """Bounds of each array in a tree, in the order of its leaves, as far as they do not depend on other parameters.

    An open end is replaced by the next number of the type `real`, at zero by the smallest normal one. Numbers without a
    declaration must be finite. None for an array of other than real numbers.
    """
    kind = np.float64 if real == "double" else np.float32
    largest, least = float(np.finfo(kind).max), float(np.finfo(kind).tiny)

    def closed(number: float | None, open_end: bool, outward: float) -> float:
        if number is None or (np.isinf(number) and open_end):
            return outward * largest
        if np.isinf(number) or not open_end:
            return number
        return -outward * least if number == 0.0 else float(np.nextafter(kind(number), kind(-outward * np.inf)))

    bounds: list[Bounds | None] = []
    for _, parameter, leaf in _declarations(tree):
        if not jnp.issubdtype(leaf.dtype, jnp.inexact):
            bounds.append(None)
        elif parameter is None:
            bounds.append(Bounds(-largest, largest))
        else:
            lower, upper = parameter.range.ends
            bounds.append(Bounds(closed(lower.number, lower.open, -1.0), closed(upper.number, upper.open, 1.0)))
    return bounds


def related_valid(tree: Any) -> Flag:
    """True if every parameter whose range depends on another parameter is in that range."""
    conditions = []
    for part, parameter, value in _declarations(tree):
        if parameter is None or not jnp.issubdtype(value.dtype, jnp.inexact):
            continue
        for end, is_lower in zip(parameter.range.ends, (True, False), strict=True):
            if end.number is None:
                bound = end.value(part)
                smaller, larger = (bound, value) if is_lower else (value, bound)
                conditions.append(jnp.ravel(larger > smaller if end.open else larger >= smaller))
    return jnp.all(jnp.concatenate(conditions)) if conditions else jnp.ones((), bool)


def _declarations(tree: Any) -> Iterator[tuple[Any, Parameter | None, Any]]:
    """For each array its part, its declaration (None if it has none), and itself."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        owner, parameter = None, None
        for place, key in way(tree, path):
            # A pytree within a parameter, such as a tuple of arrays, belongs to the part that declares it.
            if isinstance(place, AbstractPart):
                field = next(field for field in place.__dataclass_fields__.values() if field.name == key.name)
                owner, parameter = place, declared(field) if is_declared(field) else None
            elif hasattr(key, "name"):
                owner, parameter = place, None
        yield owner, None if parameter is None or parameter.piece else parameter, leaf
