"""Descriptions of parts in a scenario file, derived from the declarations of their parameters."""

from __future__ import annotations

import functools
import inspect
import math
import typing
from collections.abc import Mapping
from importlib import import_module
from typing import Annotated, Any, ClassVar, Literal, Union

import equinox as eqx
from pydantic import Field, create_model

from slidax._errors import located
from slidax.parts import Parameter, kind_of, members_of, parameters_of

from .base import AbstractDescription, Numbers, described


class PartDescription(AbstractDescription):
    """A part by the parameters of its class."""

    part: ClassVar[type]

    def build(self, **more: Any) -> Any:
        """The part.

        - `more`: what the file does not say.

        Raises DefinitionError, with the path of the field, if it is invalid.
        """
        values = {
            name: built(name, value) for name, value in self if name not in ("kind", "name") and value is not None
        }
        return self.part(**values, **more)


def built(where: str, value: Any) -> Any:
    """What a value of a description becomes: a part where it describes one, else itself.

    - `where`: the field, for messages.
    - `value`: of the field.
    """
    if isinstance(value, PartDescription):
        with located(where):
            return value.build()
    return tuple(built(f"{where}.{i}", one) for i, one in enumerate(value)) if isinstance(value, tuple) else value


@functools.cache
def description_of(part: type) -> type[PartDescription]:
    """The description of a part, whose `kind` must be given.

    - `part`: its class.
    """
    kind = kind_of(part)
    return _model(part, part.__name__, {"kind": (Literal[kind], Field(description="Which part it is."))})


def preset_of(
    part: type, owner: str, values: Mapping[str, Any], source: str, found: Mapping[str, str] = {}
) -> type[PartDescription]:
    """The description of a part of a preset: its kind, and the numbers that the preset has, need not be given.

    - `part`: its class.
    - `owner`: what the preset is called.
    - `values`, `source`: its numbers, and where they come from.
    - `found`: numbers that the scenario finds if they are not given, and from what.
    """
    kind = kind_of(part)
    fields = {"kind": (Literal[kind], Field(default=kind, description="Which part it is."))}
    return _model(part, f"{owner}.{part.__name__}", fields, values, source, found=found)


def plain_of(part: type, name: str, *, optional: bool = False, doc: str = "") -> type[PartDescription]:
    """The description of a part that needs no kind.

    - `part`: its class.
    - `name`: of the description.
    - `optional`: whether every parameter may be left out.
    - `doc`: what it is; as the part says if empty.
    """
    values = dict.fromkeys((one.name for one in parameters_of(part)), None) if optional else {}
    return _model(part, name, {}, values, doc=doc)


def union_of(family: type, *instead: type[AbstractDescription], default: type[PartDescription] | None = None) -> Any:
    """What a file can name of a family of parts: all that its room exports.

    - `family`: the abstract class.
    - `instead`: descriptions written by hand, each in place of the part of the same kind.
    - `default`: the one whose kind need not be given, in place of the plain one.
    """
    room = import_module(family.__module__.rpartition(".")[0])
    listed = {kind: part for kind, part in members_of(room, family).items() if nameable(part, family)}
    models: dict[str, type[AbstractDescription]] = {kind: description_of(part) for kind, part in listed.items()}
    for model in (*instead, *([default] if default else [])):
        models[typing.get_args(model.model_fields["kind"].annotation)[0]] = model
    return Annotated[Union[tuple(models.values())], Field(discriminator="kind")]  # noqa: UP007


def nameable(part: type, family: type) -> bool:
    """Whether a file can say all that a part needs: numbers, choices, and parts of other families.

    - `part`: its class.
    - `family`: its own.
    """
    fields = [(one, hints_of(part)[one.name]) for one in parameters_of(part)]
    return all(type_of(one, hint, family) is not None for one, hint in fields if one.required)


def title_of(part: type) -> str:
    """Title of a part: its class's `title`, else the first line of its docstring."""
    return vars(part).get("title") or inspect.cleandoc(part.__doc__ or "").partition("\n")[0]


def _model(
    part: type,
    name: str,
    first: dict[str, Any],
    values: Mapping[str, Any] = {},
    source: str = "",
    doc: str = "",
    found: Mapping[str, str] = {},
) -> type[PartDescription]:
    fields = dict(first)
    for one in parameters_of(part):
        annotation = type_of(one, hints_of(part)[one.name], part)
        if annotation is None:
            continue
        has = {"default": values[one.name], "source": source} if one.name in values else {}
        if not has and one.name in found:
            has = {"default": None, "source": found[one.name]}
        if has.get("default", one.default) in (None, math.inf):
            # JSON has no infinity: what is left out takes it.
            annotation, has = annotation | None, {**has, "default": None}
        fields[one.name] = (annotation, described(one, **has))
    model: type[PartDescription] = create_model(name, __base__=PartDescription, __doc__=doc or title_of(part), **fields)
    model.part = part
    return model


@functools.cache
def hints_of(part: type) -> dict[str, Any]:
    """The types of a part's fields.

    - `part`: its class.
    """
    return typing.get_type_hints(part)


def type_of(one: Parameter, hint: Any, family: type) -> Any:
    """The type of a field of a description; None for what a file cannot say.

    - `one`: the parameter.
    - `hint`: its type in the part.
    - `family`: the part, or its family, of which it cannot itself be made.
    """
    if one.shape == "one number":
        return int if hint is int or one.annotation.startswith("Int[") else float
    if one.shape == "one number or [n]":
        return Numbers
    if one.shape.endswith("a matrix [n n]"):
        return float | list[float] | list[list[float]]
    if one.shape in ("[n]", "[2]", "[3]", "[k]", "[m]"):
        return list[float]
    if one.shape in ("[k n]", "[m n]"):
        return list[list[float]]
    if hint in (bool, str) or typing.get_origin(hint) is Literal:
        return hint
    if inspect.isclass(hint) and issubclass(hint, eqx.Module) and inspect.isabstract(hint):
        return None if issubclass(family, hint) or hint is family else union_of(hint)
    return None
