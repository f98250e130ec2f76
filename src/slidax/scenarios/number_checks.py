"""Checks of the numbers in a description: a Boolean is not a number, and a number is finite."""

from __future__ import annotations

import functools
import inspect
import math
import typing
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

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
