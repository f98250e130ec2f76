"""Pydantic models for parts of a scenario, such as sensors and surfaces, derived from their classes' parameters.

A family is the set of all parts with a common abstract class, such as the surfaces. A preset is a named control scheme
with default parts and values.
"""

from __future__ import annotations

import functools
import inspect
import math
import typing
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Union

import equinox as eqx
import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializeAsAny,
    ValidationError,
    WrapValidator,
    create_model,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from slidax.core.errors import DefinitionError, each_of, locate_errors, nearest_word, plain_name
from slidax.core.parameter import REQUIRED, Parameter, Range, parameters_of
from slidax.core.part import kind_of, members_of

from .own_code import own_class

Numbers = Annotated[float | list[float], Field(union_mode="left_to_right")]
"""One number for all joints, or one per joint."""


def _from_folder(name: str, info: Any) -> str:
    return str(Path((info.context or {}).get("folder", "")) / name)


FileName = Annotated[str, AfterValidator(_from_folder)]
"""A path relative to the folder of the scenario file."""

CONSTRAINTS = {"exclusiveMinimum": "gt", "minimum": "ge", "exclusiveMaximum": "lt", "maximum": "le"}
"""Pydantic's names of JSON schema keywords for the ends of a range."""


Place = tuple[int | str, ...]
"""Keys and indices on the way to a value in a description."""


def require_no_booleans(model: type[BaseModel], data: Any) -> None:
    """Raise ValidationError, with the place, if the data for a model has a Boolean in place of a number.

    - `data`: mapping of the model's fields before its validation; anything else passes.
    """
    for field, enters_mappings in _number_fields(model).items() if isinstance(data, dict) else ():
        for place, value in _leaves(data.get(field), (field,), enters_mappings):
            if isinstance(value, bool | np.bool_):
                raise _refusal(model, place, f"must be a number; got {str(bool(value)).lower()}", value)


def require_finite(model: BaseModel, is_allowed: Callable[[str], bool]) -> None:
    """Raise ValidationError, with the place, if a number of a validated model is not finite.

    - `is_allowed`: True for a field that may be infinite; NaN is never allowed.
    """
    for field, enters_mappings in _number_fields(type(model)).items():
        for place, value in _leaves(getattr(model, field), (field,), enters_mappings):
            if not isinstance(value, float) or math.isfinite(value):
                continue
            if math.isnan(value) or not is_allowed(field):
                rule = "must be a number" if is_allowed(field) else "must be a finite number"
                raise _refusal(type(model), place, f"{rule}; got {value}", value)


@functools.cache
def _number_fields(model: type[BaseModel]) -> dict[str, bool]:
    """Fields that hold numbers and no Boolean; True for a field whose mappings hold numbers, not further models."""
    fields: dict[str, bool] = {}
    for name, field in model.model_fields.items():
        types = set(_types(field.annotation))
        if types & {int, float} and bool not in types:
            fields[name] = not any(inspect.isclass(kind) and issubclass(kind, BaseModel) for kind in types)
    return fields


def _types(annotation: Any) -> Iterator[Any]:
    """Yield the types in an annotation, such as float and str in `float | list[str] | None`."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        yield from _types(parts[0])
    elif origin is not typing.Literal and parts:
        for part in parts:
            yield from _types(part)
    else:
        yield annotation


def _leaves(value: Any, place: Place, enters_mappings: bool) -> Iterator[tuple[Place, Any]]:
    """Yield the single values in nested lists, and in mappings if `enters_mappings` is True, each with its place."""
    if isinstance(value, list | tuple):
        for index, entry in enumerate(value):
            yield from _leaves(entry, (*place, index), enters_mappings)
    elif isinstance(value, dict) and enters_mappings:
        for key, entry in value.items():
            yield from _leaves(entry, (*place, key), enters_mappings)
    else:
        yield place, value


def _refusal(model: type[BaseModel], place: Place, message: str, value: Any) -> ValidationError:
    # `{` and `}` would be placeholders in the text of the error itself.
    error = PydanticCustomError("unfit_number", "{message}", {"message": message})
    return ValidationError.from_exception_data(model.__name__, [InitErrorDetails(type=error, loc=place, input=value)])


class AbstractDescription(BaseModel):
    """A mapping in a scenario file: immutable, with known keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    sized: ClassVar[frozenset[str]] = frozenset()
    """Fields whose lists do not have an entry per joint."""

    may_be_infinite: ClassVar[frozenset[str]] = frozenset()
    """Fields without a declared range in which infinity means no limit."""

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = list(cls.model_fields)
            for key in data:
                if key not in known:
                    hint = nearest_word(str(key), known)
                    raise PydanticCustomError(
                        "unknown_key", "unknown key `{key}`; {hint}", {"key": plain_name(key), "hint": hint}
                    )
        require_no_booleans(cls, data)
        return data

    @model_validator(mode="after")
    def _numbers_are_finite(self) -> AbstractDescription:
        require_finite(self, self._allows_infinity)
        return self

    @classmethod
    def _allows_infinity(cls, field: str) -> bool:
        """True if a field is in `may_be_infinite`, or has a range that includes infinity."""
        extra = cls.model_fields[field].json_schema_extra
        limits = str(extra.get("range", "")) if isinstance(extra, dict) else ""
        return field in cls.may_be_infinite or "infinite" in limits or "inf]" in limits

    def require_joints(self, joints: int) -> None:
        """Raise DefinitionError unless each list in the description has one entry per joint."""
        for field, value in self:
            if isinstance(value, list) and len(value) != joints and field not in self.sized:
                message = f"must be one number or one for {each_of(joints, 'joint')}; got {len(value)}"
                raise DefinitionError(message, where=field)

    def parameters(self) -> dict[str, Any]:
        """Return the arguments of the described part: all fields with a value, except its kind."""
        return {name: value for name, value in self if name not in ("kind", "name") and value is not None}


def described_field(parameter: Parameter, *, checked: bool = False, **changes: Any) -> Any:
    """Return the pydantic field for a declared parameter of a part, with its meaning, unit, range and default.

    - `checked`: True to check the range when the file is read; False if the part checks it.
    - `changes`: `default` and `source` replace the declared ones; `required=True` removes the default.
    """
    default = REQUIRED if changes.get("required") else changes.get("default", parameter.default)
    limits, bounds = parameter.limits, parameter.range.schema()
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    # Editors use the ends of the range; the part itself checks the range and explains it in its message.
    extra = {"unit": parameter.unit, "range": limits, "source": changes.get("source", parameter.source), **bounds}
    options: dict[str, Any] = {} if default is REQUIRED else {"default": _plain(default)}
    if checked:
        options |= {CONSTRAINTS[end]: value for end, value in bounds.items()}

    # Capitalise a word at the beginning, but not a symbol such as H.
    meaning = parameter.meaning
    if meaning[:2].isascii() and meaning[:2].isalpha():
        meaning = meaning[:1].upper() + meaning[1:]
    text = f"{meaning}{unit}{f', {limits}' if limits else ''}."
    return Field(
        description=text, json_schema_extra={key: value for key, value in extra.items() if value != ""}, **options
    )


def same_field(part: type, name: str, **changes: Any) -> Any:
    """Return the pydantic field for a parameter, as `described_field` does.

    - `part`: class of a part.
    - `name`: name of a parameter of this class.
    - `changes`: as in `described_field`.
    """
    (parameter,) = (parameter for parameter in parameters_of(part) if parameter.name == name)
    return described_field(parameter, **changes)


def input_field(meaning: str, unit: str = "", range: str = "", *, default: Any = REQUIRED, source: str = "") -> Any:
    """Declare a field of a description that is not a parameter of a part; arguments as in `core.parameter.parameter`.

    The range is checked when the file is read.
    """
    return described_field(Parameter("", meaning, unit, Range(range), default=default, source=source), checked=True)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


class PartDescription(AbstractDescription):
    """A part in a scenario file: the parameters of the class `part`."""

    part: ClassVar[type]

    @classmethod
    def _allows_infinity(cls, field: str) -> bool:
        """True, as the part itself refuses infinity where it is invalid, and explains its rule."""
        return True

    def build(self, **more: Any) -> Any:
        """Build the part.

        - `more`: further arguments of the part, which are not in the file.

        Raises DefinitionError, with the path of the field, if a value is invalid.
        """
        values = {
            name: build_parts(name, value) for name, value in self if name not in ("kind", "name") and value is not None
        }
        return self.part(**values, **more)


def build_parts(where: str, value: Any) -> Any:
    """Return a field's value, in which built parts replace the descriptions of parts.

    - `where`: name of the field, for messages.
    - `value`: a description, a tuple of descriptions, or any other value, which is returned as it is.
    """
    if isinstance(value, PartDescription):
        with locate_errors(where):
            return value.build()
    return (
        tuple(build_parts(f"{where}.{i}", member) for i, member in enumerate(value))
        if isinstance(value, tuple)
        else value
    )


def description_of(part: type) -> type[PartDescription]:
    """Return the pydantic model for a part's class, with a required `kind`."""
    return _description_as(kind_of(part), part)


def preset_of(
    part: type, owner: str, values: Mapping[str, Any], source: str, computed: Mapping[str, str] = {}
) -> type[PartDescription]:
    """Return the pydantic model for a part of a preset, with the preset's kind and values as defaults.

    - `part`: class of the part.
    - `owner`: name of the preset.
    - `values`, `source`: the preset's values, and their source.
    - `computed`: parameters that are computed if the file lacks them, each with the source of its value.
    """
    kind = kind_of(part)
    fields = {"kind": (Literal[kind], Field(default=kind, description="Kind of the part."))}
    return _model(part, f"{owner}.{part.__name__}", fields, values, source, computed=computed)


def plain_of(part: type, name: str, *, optional: bool = False, doc: str = "") -> type[PartDescription]:
    """Return the pydantic model for a part's class, without a kind.

    - `name`: name of the model.
    - `optional`: True to make every parameter optional.
    - `doc`: docstring; by default the part's title.
    """
    values = {parameter.name: None for parameter in parameters_of(part)} if optional else {}
    return _model(part, name, {}, values, doc=doc)


def union_of(family: type, *instead: type[AbstractDescription], default: type[PartDescription] | None = None) -> Any:
    """Return the union of the pydantic models for all parts of a family; the kind selects one of them.

    - `family`: abstract class of the parts; its package exports them.
    - `instead`: hand-written models, which replace derived ones of the same kind.
    - `default`: a model whose kind has a default; it replaces the derived one of the same kind.
    """
    models: dict[str, type[AbstractDescription]] = {
        kind: description_of(part) for kind, part in members_of(family).items() if is_nameable(part, family)
    }
    for model in (*instead, *([default] if default else [])):
        models[typing.get_args(model.model_fields["kind"].annotation)[0]] = model
    options = (Field(discriminator="kind"), SerializeAsAny(), WrapValidator(_own_part(family)))  # type: ignore[type-arg]
    return Annotated[Union[tuple(models.values())], *options]  # noqa: UP007


def _own_part(family: type) -> Any:
    """Return a validator for parts of a `family`; the kind `module:Class` refers to a class outside slidax."""

    def validated(value: Any, others: Callable[[Any], Any], info: Any) -> Any:
        kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
        if not isinstance(kind, str) or ":" not in kind or isinstance(value, PartDescription):
            return value if isinstance(value, PartDescription) else others(value)
        try:
            part = own_class(kind, family, (info.context or {}).get("folder", ""))
            if not is_nameable(part, family):
                raise DefinitionError(f"a file cannot describe a required parameter of `{kind}`: give it a default")
        except DefinitionError as error:
            raise PydanticCustomError("own_part", "{message}", {"message": error.message}) from None
        return _description_as(kind, part).model_validate(value, context=info.context)

    return validated


@functools.cache
def _description_as(kind: str, part: type) -> type[PartDescription]:
    """Return the pydantic model for a part, which files select by this kind."""
    return _model(part, part.__name__, {"kind": (Literal[kind], Field(description="Kind of the part."))})


def is_nameable(part: type, family: type) -> bool:
    """True if a file can describe the part.

    Each required parameter must be a number, a choice, or a part of a family other than `family`.
    """
    hints = hints_of(part)
    return all(type_of(p, hints[p.name], family) is not None for p in parameters_of(part) if p.required)


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
    computed: Mapping[str, str] = {},
) -> type[PartDescription]:
    fields = dict(first)
    for parameter in parameters_of(part):
        key = parameter.name
        annotation = type_of(parameter, hints_of(part)[key], part)
        if annotation is None:
            continue
        changes = {"default": values[key], "source": source} if key in values else {}
        if not changes and key in computed:
            changes = {"default": None, "source": computed[key]}
        if changes.get("default", parameter.default) in (None, math.inf):
            # JSON has no infinity: use null instead.
            annotation, changes = annotation | None, {**changes, "default": None}
        fields[key] = (annotation, described_field(parameter, **changes))
    model: type[PartDescription] = create_model(name, __base__=PartDescription, __doc__=doc or title_of(part), **fields)
    model.part = part
    model.sized = frozenset(p.name for p in parameters_of(part) if p.shape[1:-1].isdigit())
    return model


@functools.cache
def hints_of(part: type) -> dict[str, Any]:
    """Return the types of a part's fields by name, with annotations evaluated."""
    return typing.get_type_hints(part)


def type_of(parameter: Parameter, hint: Any, family: type) -> Any:
    """Return the type of a parameter's field in a description; None if a file cannot describe it.

    - `hint`: type of the parameter in the part.
    - `family`: the part's class or its abstract class; a file cannot describe a parameter of this family.
    """
    shape = parameter.shape
    if shape == "one number":
        return int if hint is int or parameter.annotation.startswith("Int[") else float
    if shape == "one number or [n]":
        return Numbers
    if shape.endswith("a matrix [n n]"):
        return float | list[float] | list[list[float]]
    if shape in ("[n]", "[2]", "[3]", "[10]", "[k]", "[m]"):
        return list[float]
    if shape in ("[k n]", "[m n]"):
        return list[list[float]]
    if hint in (bool, str) or typing.get_origin(hint) is Literal:
        return hint
    if inspect.isclass(hint) and issubclass(hint, eqx.Module) and inspect.isabstract(hint):
        return None if issubclass(family, hint) or hint is family else union_of(hint)
    return None
