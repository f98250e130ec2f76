"""A part in readable form: its class, its parameters with their units, and its parts below it."""

from __future__ import annotations

import dataclasses
import textwrap
from typing import Any

import equinox as eqx
import jax
import numpy as np

from slidax._errors import is_traced

from .parameter import parameters_of

WIDTH = 110
"""Columns that a line has."""

LONGEST = 16
"""Matrices, and vectors with more numbers, are shown by their shape."""

KEPT = "\N{NO-BREAK SPACE}"


def as_tree(part: Any, label: str = "", indent: str = "") -> str:
    """A line for the part, and below it one for each part in it.

    - `part`: any of our modules.
    - `label`: what it is called in the part around it.
    - `indent`: before each line.
    """
    units = {said.name: said.unit for said in parameters_of(type(part))}
    values, parts = [], []
    for field in dataclasses.fields(part):
        value = getattr(part, field.name, None)
        if isinstance(value, eqx.Module):
            parts.append((field.name, value))
        elif isinstance(value, tuple) and value and all(isinstance(one, eqx.Module) for one in value):
            parts += [(f"{field.name}[{k}]", one) for k, one in enumerate(value)]
        elif value is not None:
            values.append(f"{field.name} = {_shown(value)} {units.get(field.name, '')}".rstrip())
    head = f"{label}: {type(part).__name__}" if label else type(part).__name__
    # Spaces that do not break keep each parameter on one line, as long as it fits.
    kept = [value.replace(" ", KEPT) if len(value) < WIDTH / 2 else value for value in values]
    line = f"{head}({', '.join(kept)})" if values else head
    lines = textwrap.wrap(line, WIDTH, initial_indent=indent, subsequent_indent=f"{indent}    ", break_long_words=False)
    below = [as_tree(one, name, f"{indent}  ") for name, one in parts]
    return "\n".join([*lines, *below]).replace(KEPT, " ")


def _shown(value: Any) -> str:
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float):
        return getattr(value, "__name__", None) or repr(value)
    if is_traced(value) or np.ndim(value) > 1 or np.size(value) > LONGEST:
        return f"{'traced ' if is_traced(value) else ''}[{' '.join(map(str, np.shape(value)))}]"
    numbers = [f"{number:.6g}" for number in np.ravel(value).tolist()]
    return f"[{', '.join(numbers)}]" if np.ndim(value) else numbers[0]
