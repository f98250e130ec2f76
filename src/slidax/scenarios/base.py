"""What every part of a scenario file has in common."""

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
"""A path, from the folder of the scenario file that it stands in."""

CONSTRAINTS = {"exclusiveMinimum": "gt", "minimum": "ge", "exclusiveMaximum": "lt", "maximum": "le"}
"""What pydantic calls the ends of a range that JSON schema has."""


class AbstractDescription(BaseModel):
    """A mapping in a scenario file: immutable, its keys known."""

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
        """Raises a DefinitionError unless each list in it has one entry per joint; not for lists of other things.

        - `joints`: the number of joints.
        """
        for field, value in self:
            if isinstance(value, list) and len(value) != joints:
                message = f"must be one number or one for {each_of(joints, 'joint')}; got {len(value)}"
                raise DefinitionError(message, where=field)

    def parameters(self) -> dict[str, Any]:
        """What the described part is made from: the fields that are given, but for the one that names its kind."""
        return {name: value for name, value in self if name not in ("kind", "name") and value is not None}


def described(one: Parameter, *, checked: bool = False, **said: Any) -> Any:
    """The field of a description for a declared parameter.

    - `one`: its declaration.
    - `checked`: whether the file is to refuse what is out of range, where no part does.
    - `said`: `default` or `source` in place of the declaration's, or `required`.
    """
    default = REQUIRED if said.get("required") else said.get("default", one.default)
    unit = f" [{one.unit}]" if one.unit else ""
    # Ends of a range that are numbers, each of a list's too, are for editors; the part itself says the reason.
    extra = {"unit": one.unit, "range": one.limits, "source": said.get("source", one.source), **one.range.schema()}
    given: dict[str, Any] = {} if default is REQUIRED else {"default": _plain(default)}
    if checked:
        given |= {CONSTRAINTS[end]: value for end, value in one.range.schema().items()}

    # A symbol at its beginning stays as it is.
    word = one.meaning[:2].isascii() and one.meaning[:2].isalpha()
    meaning = one.meaning[:1].upper() + one.meaning[1:] if word else one.meaning
    text = f"{meaning}{unit}{f', {one.limits}' if one.limits else ''}."
    return Field(
        description=text, json_schema_extra={key: value for key, value in extra.items() if value != ""}, **given
    )


def same(part: type, name: str, **said: Any) -> Any:
    """The field of a description for a parameter that a part declares.

    - `part`: its class.
    - `name`: of the parameter.
    - `said`: as in `described`.
    """
    (one,) = (one for one in parameters_of(part) if one.name == name)
    return described(one, **said)


def said(meaning: str, unit: str = "", range: str = "", *, default: Any = REQUIRED, source: str = "") -> Any:
    """The field of a description that no part declares, as `slidax.parts.parameter` declares one of a part.

    - `meaning`: what it is.
    - `unit`: of one of its numbers.
    - `range`: what it may be, checked when the file is read.
    - `default`: what it is if not given.
    - `source`: where that comes from.
    """
    return described(Parameter("", meaning, unit, Range(range), default=default, source=source), checked=True)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
