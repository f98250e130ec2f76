"""Validated requests from the page."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from slidax.core.errors import DefinitionError, plain_name

DEEPEST = 50
"""Largest nesting depth of a request."""

DIGITS = 330
"""Largest number of characters in a number; the largest float needs 309."""

LONGEST_PATH = 1024
"""Largest number of characters in a file name or a field's path."""

LONGEST_TEXT = 1_000_000
"""Largest number of characters in a scenario."""

MOST_CHANGES = 10_000
"""Largest number of values that a request changes."""


class RequestError(DefinitionError):
    """A request with an invalid form."""


Name = Annotated[str, Field(max_length=LONGEST_PATH)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Nothing(_Request):
    """A request without fields."""


class ScenarioRequest(_Request):
    """A scenario with changes: a built-in one by `name`, a file by `path`, or a `text` in place of the file's."""

    name: Name | None = None
    path: Name | None = None
    text: Annotated[str, Field(max_length=LONGEST_TEXT)] | None = None
    changes: Annotated[dict[Name, Any], Field(max_length=MOST_CHANGES)] | None = None


class DraftRequest(_Request):
    """A request for a new scenario for the arm `robot` at the loop rate `rate` [Hz]."""

    robot: Annotated[Name, Field(min_length=1)]
    rate: Annotated[float, Field(gt=0, le=1e9)] = 1000.0
    tip: Name | None = None

    @field_validator("rate", mode="before")
    @classmethod
    def _whole_numbers_are_numbers(cls, value: Any) -> Any:
        return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


class PartRequest(_Request):
    """A request for the parameters of a part in the catalogue, by the part's name."""

    name: Annotated[Name, Field(min_length=1)]


class JobRequest(_Request):
    """A request for a new job; `jobs.command_of` checks the values of its `options`."""

    kind: Name
    options: Annotated[dict[Name, Any], Field(max_length=100)]


QUESTIONS: dict[str, type[_Request]] = {
    "check": ScenarioRequest,
    "run": ScenarioRequest,
    "manifest": ScenarioRequest,
    "compiled": ScenarioRequest,
    "new": DraftRequest,
    "catalogue": Nothing,
    "part": PartRequest,
}
"""Models of the requests to the workbench, by the request's name."""

Kind = TypeVar("Kind", bound=_Request)


def read_request(content: bytes, kind: type[Kind]) -> Kind:
    """Return the request in a JSON text, validated.

    - `content`: the text, as bytes.
    - `kind`: class of the request.

    Raises RequestError with the field and the rule.
    """
    try:
        data = json.loads(content, parse_constant=_refuse_constant, parse_int=_integer, parse_float=_number)
    except RequestError:
        raise
    except (ValueError, RecursionError):
        raise RequestError("the request must be JSON") from None
    if not isinstance(data, dict):
        raise RequestError("the request must be a mapping")
    _require_plain(data)
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(plain_name(part) for part in first["loc"] if part != "[key]")
        raise RequestError(_sentence(first["type"], first["msg"], kind), where=where) from None


def _sentence(rule: str, message: str, kind: type[_Request]) -> str:
    if rule == "extra_forbidden":
        fields = ", ".join(f"`{name}`" for name in kind.model_fields)
        return f"unknown field; allowed: {fields}" if fields else "unknown field: this request has no fields"
    if rule == "missing":
        return "this field is required"
    return message[:1].lower() + message[1:]


def _require_plain(data: Any) -> None:
    """Raise RequestError if values are nested too deeply, or a text has an incomplete surrogate pair."""
    level: list[Any] = [data]
    for _ in range(DEEPEST + 1):
        below: list[Any] = []
        for value in level:
            if isinstance(value, str):
                _require_text(value)
            elif isinstance(value, dict):
                for key in value:
                    _require_text(key)
                below.extend(value.values())
            elif isinstance(value, list):
                below.extend(value)
        if not below:
            return
        level = below
    raise RequestError(f"the request is nested more than {DEEPEST} levels deep")


def _require_text(text: str) -> None:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise RequestError(f"`{plain_name(text)}` has an incomplete surrogate pair") from None


def _refuse_constant(word: str) -> float:
    raise RequestError(f"`{word}` is not a JSON number")


def _integer(word: str) -> int:
    _require_short(word)
    if not math.isfinite(float(word)):
        raise RequestError(f"the number `{plain_name(word)}` is too large")
    return int(word)


def _number(word: str) -> float:
    _require_short(word)
    number = float(word)
    if not math.isfinite(number):
        raise RequestError(f"the number `{plain_name(word)}` is too large")
    return number


def _require_short(word: str) -> None:
    if len(word) > DIGITS:
        raise RequestError(f"the number `{plain_name(word)}` has {len(word)} characters; at most {DIGITS} are allowed")
