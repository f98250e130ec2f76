"""Base class of all components of a control loop, their names in files and their printed form."""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
from functools import cache
from importlib import import_module
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np

from .errors import DefinitionError, is_traced, require, require_consistent, require_shape
from .parameter import Parameter, declaration, is_declared, parameters_of

WIDTH = 110
"""Columns of a printed line."""

LONGEST = 16
"""Longest vector whose numbers are printed; longer vectors and matrices are printed as their shape."""

NO_BREAK = "\N{NO-BREAK SPACE}"


def as_tree(part: Any, label: str = "", indent: str = "") -> str:
    """Return a part as text: a line with its values, and below it a line for each part inside it.

    - `label`: name of the part's field in the outer part. `indent`: spaces before the line.
    """
    kind: type = type(part)
    units = {parameter.name: parameter.unit for parameter in parameters_of(kind)}
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
    values = [value.replace(" ", NO_BREAK) if len(value) < WIDTH / 2 else value for value in values]
    line = f"{head}({', '.join(values)})" if values else head
    lines = textwrap.wrap(line, WIDTH, initial_indent=indent, subsequent_indent=f"{indent}    ", break_long_words=False)
    below = [as_tree(inner, name, f"{indent}  ") for name, inner in parts]
    return "\n".join([*lines, *below]).replace(NO_BREAK, " ")


def _shown(value: Any) -> str:
    if not isinstance(value, jax.Array | np.ndarray | np.generic | float):
        return getattr(value, "__name__", None) or repr(value)
    if is_traced(value) or np.ndim(value) > 1 or np.size(value) > LONGEST:
        return f"{'traced ' if is_traced(value) else ''}[{' '.join(map(str, np.shape(value)))}]"
    numbers = [f"{number:.6g}" for number in np.ravel(value).tolist()]
    return f"[{', '.join(numbers)}]" if np.ndim(value) else numbers[0]


class AbstractPart(eqx.Module):
    """An immutable component of a control loop, whose fields are declared by `parameter` and `piece`.

    The constructor checks shapes and ranges of all values that JAX does not trace. A subclass checks further rules in
    its `__check_init__`. Its docstring has the formula and its source; a line is added for each declared parameter.
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
                cls.__doc__ += "\n\nRaises DefinitionError if a parameter is out of its range."

    def __repr__(self) -> str:
        return as_tree(self)

    def __check_init__(self) -> None:
        parameters = [p for p in _numeric(type(self)) if getattr(self, p.name) is not None]
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


@cache
def _numeric(part: type[AbstractPart]) -> tuple[Parameter, ...]:
    """The declared parameters of a part that are numeric."""
    fields = (declaration(field) for field in dataclasses.fields(part) if is_declared(field))
    return tuple(parameter for parameter in fields if not parameter.piece)


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
    # Only a dimension n counts joints; others count rows or terms.
    each = "joint" if parameter.shape.endswith("n]") else "entry"
    require(part, parameter.name, holds, parameter.rule(part), finite=not endless, each=each)


def _declared_in(cls: type) -> list[Parameter]:
    """The declarations of a class that is not a dataclass yet, with inherited ones."""
    parameters: dict[str, Parameter] = {}
    for owner in reversed(cls.__mro__[1:]):
        if dataclasses.is_dataclass(owner):
            parameters |= {field.name: declaration(field) for field in dataclasses.fields(owner) if is_declared(field)}
    annotations = inspect.get_annotations(cls)
    for name, value in vars(cls).items():
        if isinstance(value, dataclasses.Field) and is_declared(value):
            parameters[name] = dataclasses.replace(declaration(value, str(annotations.get(name, ""))), name=name)
    return list(parameters.values())


def kind_of(part: type) -> str:
    """Return the name of a part's class in files: in snake case, without the name of its base class.

    `FixedTimeReaching` is `fixed_time`, `PrescribedPerformance` is `prescribed_performance`. The class variable `kind`,
    if it is set, is the name instead.
    """
    if own := vars(part).get("kind"):
        return str(own)
    families = [base.__name__.removeprefix("Abstract") for base in part.__mro__[1:] if base.__module__ != "equinox"]
    name = part.__name__
    for family in families:
        if name.endswith(family) and name != family:
            name = name.removesuffix(family)
            break
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def members_of(family: type) -> dict[str, Any]:
    """Return the concrete subclasses of an abstract class that its package exports, by their names in files."""
    package = import_module(".".join(family.__module__.split(".")[:2]))
    members = {
        kind_of(thing): thing
        for thing in vars(package).values()
        if inspect.isclass(thing) and issubclass(thing, family) and not inspect.isabstract(thing)
    }
    # Sorted, since the order of the exports has no meaning.
    return dict(sorted(members.items()))
