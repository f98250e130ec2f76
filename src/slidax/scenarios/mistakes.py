"""Validation errors of a file in plain English."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from slidax._errors import DefinitionError, counted, nearest, plain, shown

LIMITS = {
    "greater_than": (">", "gt"),
    "greater_than_equal": (">=", "ge"),
    "less_than": ("<", "lt"),
    "less_than_equal": ("<=", "le"),
}
"""Pydantic's errors about a range: sign, and key of the limit."""


def translated(error: ValidationError, data: Any) -> DefinitionError:
    """Return the first of pydantic's errors about the data as one plain sentence."""
    mistakes = error.errors(include_url=False)
    first = mistakes[0]
    where = _path(first, data)
    together = [mistake for mistake in mistakes if _path(mistake, data) == where]
    kinds = {mistake["type"] for mistake in together}
    context = first.get("ctx", {})
    value = first.get("input")
    if first["type"] == "missing":
        message = "is missing"
    elif first["type"] == "union_tag_not_found":
        message = f"needs a {context['discriminator']}, one of the known kinds"
    elif first["type"] == "union_tag_invalid":
        known = [word.strip().strip("'") for word in context["expected_tags"].split(",")]
        where = f"{where}.{context['discriminator'].strip(chr(39))}"
        message = f"unknown `{plain(context['tag'])}`; {nearest(str(context['tag']), known)}"
    elif first["type"] == "literal_error":
        known = [word.strip().strip("'") for word in context["expected"].replace(" or ", ",").split(",")]
        message = f"unknown `{plain(value)}`; {nearest(str(value), known)}"
    elif "list_type" in kinds and kinds & {"float_type", "float_parsing"}:
        message = f"must be a number or a list of numbers; got {shown(value)}"
    elif first["type"] in ("float_type", "float_parsing"):
        message = f"must be a number; got {shown(value)}"
    elif first["type"] == "list_type":
        message = f"must be a list; got {shown(value)}"
    elif first["type"] in LIMITS:
        sign, limit = LIMITS[first["type"]]
        message = f"must be {sign} {context[limit]:g}; got {shown(value)}"
    elif first["type"] in ("too_short", "too_long"):
        sign, limit = (">=", "min_length") if first["type"] == "too_short" else ("<=", "max_length")
        message = f"must have {sign} {counted(context[limit], 'entry', 'entries')}; got {shown(value)}"
    elif first["type"] == "unknown_key":
        message = first["msg"]
    else:
        message = f"{first['msg'][0].lower()}{first['msg'][1:]}; got {shown(value)}"
    return DefinitionError(message, where=where)


def _path(mistake: Any, data: Any) -> str:
    """The path of the file's keys, without the names of union members that pydantic adds."""
    loc: tuple[int | str, ...] = mistake["loc"]
    absent = len(loc) - 1 if mistake["type"] == "missing" else -1
    parts: list[str] = []
    place = data
    for depth, part in enumerate(loc):
        if isinstance(place, dict) and (part in place or depth == absent):
            place = place.get(part)
            parts.append(str(part))
        elif isinstance(place, list) and isinstance(part, int) and part < len(place):
            place = place[part]
            parts.append(str(part))
    return ".".join(parts)
