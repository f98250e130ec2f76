"""What every part of a closed loop is."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from slidax._errors import DefinitionError, is_traced, require, require_consistent, require_shape

from .parameter import Parameter, declared, is_declared
from .tree import as_tree


class AbstractPart(eqx.Module):
    """A frozen piece of a closed loop, whose fields are declared by `parameter` and `piece`.

    Shapes and ranges are checked when it is made, as far as values are known; `__check_init__` of a class is for rules
    that no range can say. The docstring of a class gives the formula and its source; a line for each parameter is added
    to it from the declarations.
    """

    # One line without a formula: `slidax list`, the JSON schema and the tables of parameters show it.
    title: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        bullets = [said.bullet() for said in _said_of(cls)]
        if bullets:
            own = inspect.cleandoc(cls.__doc__ or "")
            listed = "\n".join(bullets)
            cls.__doc__ = f"{own}\n\n{listed}"
            if not all(said.piece for said in _said_of(cls)):
                cls.__doc__ += "\n\nRaises DefinitionError if one of them is out of its range."

    def __repr__(self) -> str:
        return as_tree(self)

    def __check_init__(self) -> None:
        fields = [declared(field) for field in dataclasses.fields(self) if is_declared(field)]
        said = [one for one in fields if not one.piece and getattr(self, one.name) is not None]
        require_consistent(self, *(one.name for one in said if one.shape in PER_JOINT))
        for one in said:
            value = getattr(self, one.name)
            if one.shape in SIZES:
                require_shape(self, SIZES[one.shape], one.name)
            elif one.shape == "[n]" and np.ndim(value) != 1:
                given = list(np.shape(value))
                raise DefinitionError(
                    f"`{type(self).__name__}.{one.name}` must have one entry per joint; got shape {given}"
                )
        # A range whose end is another parameter comes last, when that parameter is known to be right.
        for one in sorted(said, key=_depends):
            if one.shape and not is_traced(getattr(self, one.name)):
                _require_range(self, one)


PER_JOINT = ("one number or [n]", "[n]")
"""The shapes of what must have as many entries as the other parameters, if it has one per joint."""

SIZES: dict[str, tuple[int, ...]] = {"one number": (), "[2]": (2,), "[3]": (3,), "[3 3]": (3, 3)}


def _depends(said: Parameter) -> bool:
    return any(end.number is None for end in said.range.ends)


def _require_range(part: AbstractPart, said: Parameter) -> None:
    lower, upper = said.range.ends
    # An end that is another parameter may be traced where this one is not.
    if _depends(said) and is_traced(part):
        return
    value = np.asarray(getattr(part, said.name))
    holds = said.range.holds(part, value)
    endless = any(end.number is not None and np.isinf(end.number) and not end.open for end in (lower, upper))
    # What has an entry per row or per term must not blame a joint.
    each = "joint" if said.shape.endswith("n]") else "entry"
    require(part, said.name, holds, said.rule(part), finite=not endless, each=each)


def _said_of(cls: type) -> list[Parameter]:
    """The declarations of a class that is not a dataclass yet, with those that it inherits."""
    found: dict[str, Parameter] = {}
    for owner in reversed(cls.__mro__[1:]):
        if dataclasses.is_dataclass(owner):
            found |= {field.name: declared(field) for field in dataclasses.fields(owner) if is_declared(field)}
    annotations = inspect.get_annotations(cls)
    for name, value in vars(cls).items():
        if isinstance(value, dataclasses.Field) and is_declared(value):
            found[name] = dataclasses.replace(declared(value, str(annotations.get(name, ""))), name=name)
    return list(found.values())
