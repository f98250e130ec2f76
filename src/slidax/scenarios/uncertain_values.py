"""Values of a scenario by path, with their units, ranges and lengths."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from slidax.arms.arm import AbstractRobot
from slidax.core.errors import DefinitionError, nearest_word, plain_name, short_repr

Array: TypeAlias = NDArray[Any]

NUMERIC = {float, int, list[float], list[list[float]]}

ENDS = (("minimum", -np.inf), ("exclusiveMinimum", -np.inf)), (("maximum", np.inf), ("exclusiveMaximum", np.inf))


def is_index(word: str) -> bool:
    """True for an index of a list: ASCII digits, few enough for `int`."""
    return word.isascii() and word.isdigit() and len(word) < 10


@dataclasses.dataclass(frozen=True)
class Leaf:
    """A value of a scenario that a study can vary: a number or a list of numbers.

    - `path`: its dotted path.
    - `own`: its value in the scenario; None if the scenario has none.
    - `joints`: number of joints of the arm.
    - `per_joint`: True if the value may be a number for all joints, or a list with a number for each joint.
    - `one_of_joints`: True for a joint's entry in a list with an entry for each joint.
    - `open_list`: True for a list of any length.
    - `integer`: True for integers.
    - `unit`: its unit.
    - `ends`: numeric ends of its range.
    - `envelope`: function that returns the lower and the upper start positions inside the envelope [n]; None unless the
      set needs them.
    - `arm`: function that returns the nominal arm; None unless the set needs it.
    """

    path: str
    own: Array | None
    joints: int
    per_joint: bool = False
    one_of_joints: bool = False
    open_list: bool = False
    integer: bool = False
    unit: str = ""
    ends: tuple[float, float] = (-np.inf, np.inf)
    envelope: Callable[[], tuple[Array, Array]] | None = dataclasses.field(default=None, compare=False)
    arm: Callable[[], AbstractRobot] | None = dataclasses.field(default=None, compare=False)

    @property
    def each_joint(self) -> bool:
        """True if the value has, or may have, a number for each joint."""
        return self.per_joint or (self.open_list and self.shape == (self.joints,))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the scenario's value; () without a value."""
        return () if self.own is None else self.own.shape

    @property
    def shape_of_each(self) -> tuple[int, ...]:
        """Shape of a draw with separate numbers: [n] for a value per joint that the scenario sets by one number."""
        return (self.joints,) if self.per_joint and self.shape == () else self.shape

    @property
    def size(self) -> int:
        """Number of draws if each number is drawn separately."""
        return int(np.prod(self.shape_of_each, dtype=int))

    def own_value(self, key: str) -> Array:
        """Return the scenario's value.

        - `key`: key of the set that needs the value, for the message.

        Raises DefinitionError if the scenario has no value.
        """
        if self.own is None:
            raise DefinitionError(f"has no value in the scenario, which `{key}` needs: write a value")
        return self.own

    def fitting(self, value: Any, key: str) -> Array:
        """Return a parameter of a set as an array, broadcast to the shape of the scenario's value.

        - `value`: a number, or a list with a number for each entry.
        - `key`: key of this parameter in the set, for the message.

        Raises DefinitionError if `value` has another shape, or is not finite.
        """
        array = np.asarray(value, float)
        allowed = {(), self.shape, self.shape_of_each}
        if array.shape not in allowed and self.own is not None:
            wanted = " or ".join("one number" if not shape else f"{list(shape)} numbers" for shape in sorted(allowed))
            raise DefinitionError(f"`{key}` needs {wanted}; got {short_repr(value)}")
        if not np.isfinite(array).all():
            raise DefinitionError(f"`{key}` must be finite; got {short_repr(value)}")
        return self.spread_out(array, False)

    def spread_out(self, value: Array, each: bool) -> Array:
        """Broadcast a value to `shape`, or to `shape_of_each` if `each` is True."""
        return np.broadcast_to(value, np.broadcast_shapes(value.shape, self.shape_of_each if each else self.shape))


def leaf_of(description: BaseModel, path: str, joints: int) -> Leaf:
    """Return the value at a path of a scenario's description.

    - `path`: dotted path, as with `--set`.
    - `joints`: number of joints of the arm.

    Raises DefinitionError if there is no number at this path.
    """
    node: Any = description
    kind: Any = None
    schema: Mapping[str, Any] = {}
    open_list = one_of_joints = False
    for name in path.split("."):
        if isinstance(node, BaseModel):
            fields = type(node).model_fields
            if name not in fields:
                raise DefinitionError(f"there is no `{plain_name(name)}` here; {nearest_word(name, fields)}")
            kind, extra = fields[name].annotation, fields[name].json_schema_extra
            schema = extra if isinstance(extra, dict) else {}
            node = getattr(node, name)
            open_list = list[float] in _types(kind) and not _has_length(fields[name])
        elif isinstance(node, tuple | list) and is_index(name) and int(name) < len(node):
            one_of_joints = open_list and len(node) == joints
            node, kind = node[int(name)], float
        elif is_index(name) and isinstance(node, int | float):
            raise DefinitionError(f"{node} is a single number for all joints: write a list with one for each joint")
        else:
            raise DefinitionError(f"`{plain_name(name)}` does not exist in {short_repr(node)}")
    types = _types(kind)
    if not types & NUMERIC or isinstance(node, BaseModel | str | bool):
        raise DefinitionError(f"is not a number of the scenario; got {short_repr(node)}")
    try:
        array = None if node is None else np.asarray(node, int if types == {int} else float)
    except (TypeError, ValueError):
        raise DefinitionError(f"is not a number of the scenario; got {short_repr(node)}") from None
    lower, upper = (next((schema[key] for key, _ in end if key in schema), end[0][1]) for end in ENDS)
    return Leaf(
        path,
        array,
        joints,
        per_joint=float in types and list[float] in types,
        one_of_joints=one_of_joints,
        open_list=open_list,
        integer=int in types and float not in types,
        unit=str(schema.get("unit", "")),
        ends=(float(lower), float(upper)),
    )


def _has_length(field: FieldInfo) -> bool:
    """True for a list of fixed length, such as the three numbers of a point."""
    return "MinLen" in str(field.metadata) or "min_length" in str(field.annotation)


def _types(kind: Any) -> set[Any]:
    """The types of a union, without None and without pydantic's annotations."""
    if typing.get_origin(kind) is typing.Annotated:
        return _types(typing.get_args(kind)[0])
    if typing.get_origin(kind) in (None, list, tuple, typing.Literal):
        return {kind} - {type(None)}
    return set().union(*(_types(member) for member in typing.get_args(kind)))


def with_values(description: Any, values: Mapping[str, Any]) -> Any:
    """Return a copy of a scenario's description with new values by dotted path.

    - `values`: values that are not validated, and that JAX may trace.
    """
    for path, value in values.items():
        description = _with(description, path.split("."), value)
    return description


def _with(node: Any, names: list[str], value: Any) -> Any:
    if not names:
        return value
    name, *rest = names
    if isinstance(node, BaseModel):
        return node.model_copy(update={name: _with(getattr(node, name), rest, value)})
    changed = [_with(entry, rest, value) if k == int(name) else entry for k, entry in enumerate(node)]
    return tuple(changed) if isinstance(node, tuple) else changed
