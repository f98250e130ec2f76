"""Readable form of a part: its class, its parameters with their units, and its inner parts."""

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
"""Columns of a line."""

LONGEST = 16
"""Longest vector that is shown by its numbers; longer ones and matrices are shown by their shape."""

KEPT = "\N{NO-BREAK SPACE}"


def as_tree(part: Any, label: str = "", indent: str = "") -> str:
    """Return a line for the part, and below it one for each inner part; `label` is its name in the outer part."""
    units = {parameter.name: parameter.unit for parameter in parameters_of(type(part))}
    values, parts = [], []
    for field in dataclasses.fields(part):
        value = getattr(part, field.name, None)
        if isinstance(value, eqx.Module):
            parts.append((field.name, value))
        elif isinstance(value, tuple) and value and all(isinstance(member, eqx.Module) for member in value):
            parts += [(f"{field.name}[{k}]", member) for k, member in enumerate(value)]
        elif value is not None:
            values.append(f"{field.name} = {_shown(value)} {units.get(field.name, '')}".rstrip())
    head = f"{label}: {type(part).__name__}" if label else type(part).__name__
    # No-break spaces keep each short parameter on one line.
    kept = [value.replace(" ", KEPT) if len(value) < WIDTH / 2 else value for value in values]
    line = f"{head}({', '.join(kept)})" if values else head
    lines = textwrap.wrap(line, WIDTH, initial_indent=indent, subsequent_indent=f"{indent}    ", break_long_words=False)
    below = [as_tree(inner, name, f"{indent}  ") for name, inner in parts]
    return "\n".join([*lines, *below]).replace(KEPT, " ")


def _shown(value: Any) -> str:
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float):
        return getattr(value, "__name__", None) or repr(value)
    if is_traced(value) or np.ndim(value) > 1 or np.size(value) > LONGEST:
        return f"{'traced ' if is_traced(value) else ''}[{' '.join(map(str, np.shape(value)))}]"
    numbers = [f"{number:.6g}" for number in np.ravel(value).tolist()]
    return f"[{', '.join(numbers)}]" if np.ndim(value) else numbers[0]
