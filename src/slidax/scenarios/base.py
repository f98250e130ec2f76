"""Base class of all descriptions in a scenario file, and their fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from slidax._errors import DefinitionError, each_of, nearest, plain
from slidax.parts import REQUIRED, Parameter, Range, parameters_of

Numbers = Annotated[float | list[float], Field(union_mode="left_to_right")]
"""One number for all joints, or one per joint."""


def _from_folder(name: str, info: Any) -> str:
    return str(Path((info.context or {}).get("folder", "")) / name)


FileName = Annotated[str, AfterValidator(_from_folder)]
"""A path relative to the folder of the scenario file."""

CONSTRAINTS = {"exclusiveMinimum": "gt", "minimum": "ge", "exclusiveMaximum": "lt", "maximum": "le"}
"""Pydantic's names of JSON schema keywords for the ends of a range."""


class AbstractDescription(BaseModel):
    """A mapping in a scenario file: immutable, with known keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = list(cls.model_fields)
            for key in data:
                if key not in known:
                    hint = nearest(str(key), known)
                    raise PydanticCustomError(
                        "unknown_key", "unknown key `{key}`; {hint}", {"key": plain(key), "hint": hint}
                    )
        return data

    def require_joints(self, joints: int) -> None:
        """Raise DefinitionError unless each list in the description has one entry per joint."""
        for field, value in self:
            if isinstance(value, list) and len(value) != joints:
                message = f"must be one number or one for {each_of(joints, 'joint')}; got {len(value)}"
                raise DefinitionError(message, where=field)

    def parameters(self) -> dict[str, Any]:
        """Return the arguments of the described part: all fields with a value, except its kind."""
        return {name: value for name, value in self if name not in ("kind", "name") and value is not None}


def described(parameter: Parameter, *, checked: bool = False, **changes: Any) -> Any:
    """Return the field of a description for a declared parameter.

    - `checked`: True if the file checks the range, since no part does.
    - `changes`: `default` or `source` that replace the declaration's, or `required`.
    """
    default = REQUIRED if changes.get("required") else changes.get("default", parameter.default)
    limits, bounds = parameter.limits, parameter.range.schema()
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    # Editors use the numeric ends of a range; the part itself checks it, with the reason in the message.
    extra = {"unit": parameter.unit, "range": limits, "source": changes.get("source", parameter.source), **bounds}
    options: dict[str, Any] = {} if default is REQUIRED else {"default": _plain(default)}
    if checked:
        options |= {CONSTRAINTS[end]: value for end, value in bounds.items()}

    # A symbol at the beginning keeps its case.
    meaning = parameter.meaning
    if meaning[:2].isascii() and meaning[:2].isalpha():
        meaning = meaning[:1].upper() + meaning[1:]
    text = f"{meaning}{unit}{f', {limits}' if limits else ''}."
    return Field(
        description=text, json_schema_extra={key: value for key, value in extra.items() if value != ""}, **options
    )


def same(part: type, name: str, **changes: Any) -> Any:
    """Return the field of a description for a parameter of a part's class, with changes as in `described`."""
    (parameter,) = (parameter for parameter in parameters_of(part) if parameter.name == name)
    return described(parameter, **changes)


def said(meaning: str, unit: str = "", range: str = "", *, default: Any = REQUIRED, source: str = "") -> Any:
    """Declare the field of a description that is no parameter of a part; arguments as of `slidax.parts.parameter`.

    The range is checked when the file is read.
    """
    return described(Parameter("", meaning, unit, Range(range), default=default, source=source), checked=True)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
