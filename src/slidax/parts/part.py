"""Base class of the parts of a closed loop."""

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

    The constructor checks shapes and ranges of known values; `__check_init__` of a class checks rules that no range
    expresses. The docstring of a class has the formula and its source, and gets a line for each declared parameter.
    """

    # One line without a formula: `slidax list`, the JSON schema and the tables of parameters show it.
    title: ClassVar[str] = ""

    # Name in files; empty to derive it from the name of the class.
    kind: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        parameters = _declared_in(cls)
        if parameters:
            own = inspect.cleandoc(cls.__doc__ or "")
            listed = "\n".join(parameter.bullet() for parameter in parameters)
            cls.__doc__ = f"{own}\n\n{listed}"
            if not all(parameter.piece for parameter in parameters):
                cls.__doc__ += "\n\nRaises DefinitionError if one of them is out of its range."

    def __repr__(self) -> str:
        return as_tree(self)

    def __check_init__(self) -> None:
        fields = [declared(field) for field in dataclasses.fields(self) if is_declared(field)]
        parameters = [p for p in fields if not p.piece and getattr(self, p.name) is not None]
        require_consistent(self, *(p.name for p in parameters if p.shape in PER_JOINT))
        for parameter in parameters:
            value = getattr(self, parameter.name)
            if parameter.shape in SIZES:
                require_shape(self, SIZES[parameter.shape], parameter.name)
            elif parameter.shape == "[n]" and np.ndim(value) != 1:
                raise DefinitionError(
                    f"`{type(self).__name__}.{parameter.name}` must have one entry per joint; got shape "
                    f"{list(np.shape(value))}"
                )
        # A range whose end is another parameter comes last, after the check of that parameter.
        for parameter in sorted(parameters, key=_depends):
            if parameter.shape and not is_traced(getattr(self, parameter.name)):
                _require_range(self, parameter)


PER_JOINT = ("one number or [n]", "[n]")
"""Shapes of parameters that must agree in their number of joints."""

SIZES: dict[str, tuple[int, ...]] = {"one number": (), "[2]": (2,), "[3]": (3,), "[3 3]": (3, 3)}


def _depends(parameter: Parameter) -> bool:
    return any(end.number is None for end in parameter.range.ends)


def _require_range(part: AbstractPart, parameter: Parameter) -> None:
    lower, upper = parameter.range.ends
    # Another parameter at an end of the range may be traced even if this one is not.
    if _depends(parameter) and is_traced(part):
        return
    value = np.asarray(getattr(part, parameter.name))
    holds = parameter.range.holds(part, value)
    endless = any(end.number is not None and np.isinf(end.number) and not end.open for end in (lower, upper))
    # An entry per row or per term is not a joint's.
    each = "joint" if parameter.shape.endswith("n]") else "entry"
    require(part, parameter.name, holds, parameter.rule(part), finite=not endless, each=each)


def _declared_in(cls: type) -> list[Parameter]:
    """The declarations of a class that is not a dataclass yet, with inherited ones."""
    parameters: dict[str, Parameter] = {}
    for owner in reversed(cls.__mro__[1:]):
        if dataclasses.is_dataclass(owner):
            parameters |= {field.name: declared(field) for field in dataclasses.fields(owner) if is_declared(field)}
    annotations = inspect.get_annotations(cls)
    for name, value in vars(cls).items():
        if isinstance(value, dataclasses.Field) and is_declared(value):
            parameters[name] = dataclasses.replace(declared(value, str(annotations.get(name, ""))), name=name)
    return list(parameters.values())
