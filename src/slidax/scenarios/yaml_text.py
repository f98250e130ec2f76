"""Reading and writing of YAML, and validation errors in plain English."""

from __future__ import annotations

import io
from collections.abc import Iterable
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from textwrap import fill
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.error import YAMLError

from slidax.core.errors import DefinitionError, count_noun, nearest_word, plain_name, short_repr
from slidax.core.files import read_text

from .descriptions import AbstractDescription

MOST_CHARACTERS = 250_000
"""Largest number of characters in a YAML text. The parser takes ten seconds for the densest text of this length."""

MOST_VALUES = 250_000
"""Largest number of values with all aliases expanded: without this limit a few lines could exhaust the memory."""

DEEPEST = 50
"""Largest depth of nested lists and mappings."""

LONG = "put a long motion into a file of its own, such as `trajectory: {kind: csv, file: motion.csv}`"


def read_yaml_file(path: Path, what: str = "the file") -> Any:
    """Read the value in a YAML file; `what` is its name in messages.

    Raises DefinitionError, with the file and the line, if it cannot be read, is not YAML, or is too large.
    """
    text = read_text(path, what)
    try:
        return read_yaml(text)
    except DefinitionError as error:
        raise DefinitionError(f"{what} `{path}`: {error}") from None


def read_yaml(text: str) -> Any:
    """Return the value in a YAML 1.2 text.

    Raises DefinitionError, with the line if known, if it is not YAML, or is too large.
    """
    if len(text) > MOST_CHARACTERS:
        raise DefinitionError(f"the YAML has {len(text)} characters; at most {MOST_CHARACTERS} are allowed; {LONG}")
    return deepcopy(_parsed(text))


# Parsing takes a quarter of the time to load a scenario, and programs load the same one again and again.
@lru_cache(maxsize=32)
def _parsed(text: str) -> Any:
    try:
        value = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark else ""
        raise DefinitionError(f"not valid YAML{line}: {getattr(error, 'problem', None) or error}") from None
    except RecursionError:
        raise _too_deep() from None
    # The parser raises Python's own errors for a value that does not fit its tag, as in `!!float ""` or a 13th month.
    except (ValueError, LookupError, TypeError, AttributeError, AssertionError) as error:
        raise DefinitionError(f"not valid YAML: a value does not fit its tag or form: {error}") from None
    require_readable(value)
    return value


def require_readable(value: Any) -> None:
    """Raise DefinitionError if a value contains itself, is too large or too deep, or has a key that is not text."""
    _size(value, {}, set(), DEEPEST)


def _size(value: Any, known: dict[int, int], inside: set[int], left: int) -> int:
    """Number of nested values, including the value itself, with all aliases expanded."""
    if not isinstance(value, (dict, list)):
        return 1
    if id(value) in known:
        return known[id(value)]
    if id(value) in inside:
        raise DefinitionError("an alias in the YAML refers to a value that contains it: remove the alias")
    if not left:
        raise _too_deep()
    for key in value if isinstance(value, dict) else ():
        if not isinstance(key, str):
            raise DefinitionError(f"a key must be text; got `{short_repr(key)}`: write it in quotation marks")
    inside.add(id(value))
    parts: Iterable[Any] = value.values() if isinstance(value, dict) else value
    size = 1 + sum(_size(part, known, inside, left - 1) for part in parts)
    inside.remove(id(value))
    if size > MOST_VALUES:
        raise DefinitionError(f"the YAML has more than {MOST_VALUES} values with expanded aliases; {LONG}")
    known[id(value)] = size
    return size


def _too_deep() -> DefinitionError:
    return DefinitionError(f"the YAML has more than {DEEPEST} levels of lists and mappings: nest them less")


def as_yaml(description: AbstractDescription) -> str:
    """Return the description of a scenario or a study as YAML that can be read again, with all default values."""
    return dump_yaml(_shown(description))


def dump_yaml(values: Any, width: int = 100) -> str:
    """Return mappings, lists and single values as YAML, in lines of about `width` characters."""
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = width
    text = io.StringIO()
    yaml.dump(values, text)
    return text.getvalue()


def dump_commented(values: Any, comments: Iterable[tuple[str, str]]) -> str:
    """Return a mapping as YAML with comments, and an empty line before each of its keys.

    - `comments`: pairs of a key's path, such as `scheme.bound`, and the comment before the key. A missing key is
      skipped. Lines that start with `- ` are items of a list.
    """
    document = _commentable(values)
    for name in list(document)[1:]:
        document.yaml_set_comment_before_after_key(name, before="\n")
    for path, text in comments:
        *parents, name = path.split(".")
        block, indent = document, 2 * len(parents)
        for key in parents:
            block = block.get(key, {})
        if name in block:
            block.yaml_set_comment_before_after_key(name, before=_filled(text, 116 - indent), indent=indent)
    return dump_yaml(document, 116)


def _commentable(value: Any) -> Any:
    if isinstance(value, dict):
        return CommentedMap({name: _commentable(part) for name, part in value.items()})
    return [_commentable(part) for part in value] if isinstance(value, list | tuple) else value


def _filled(text: str, width: int) -> str:
    """Wrap each line, with a hanging indent for items of a list."""
    return "\n".join(
        fill(line, width, subsequent_indent="  " if line.startswith("- ") else "", break_on_hyphens=False)
        for line in text.splitlines()
    )


def _shown(value: Any) -> Any:
    """Convert a value to plain types for YAML, and omit nulls that are defaults."""
    if isinstance(value, AbstractDescription):
        defaults = {name: field.default for name, field in type(value).model_fields.items()}
        return {name: _shown(part) for name, part in value if part is not None or defaults[name] is not None}
    if isinstance(value, dict):
        return {name: _shown(part) for name, part in value.items()}
    return [_shown(part) for part in value] if isinstance(value, list | tuple) else value


LIMITS = {
    "greater_than": (">", "gt"),
    "greater_than_equal": (">=", "ge"),
    "less_than": ("<", "lt"),
    "less_than_equal": ("<=", "le"),
}
"""Sign and context key of the limit for pydantic's range errors."""


def validation_error(error: ValidationError, data: Any) -> DefinitionError:
    """Return pydantic's first error as a DefinitionError, with a plain sentence and the path of the field.

    - `data`: the validated mapping.
    """
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
        message = f"needs a {context['discriminator']}; `slidax list` shows the known ones"
    elif first["type"] == "union_tag_invalid":
        known = [word.strip().strip("'") for word in context["expected_tags"].split(",")]
        where = f"{where}.{context['discriminator'].strip(chr(39))}"
        message = f"unknown `{plain_name(context['tag'])}`; {nearest_word(str(context['tag']), known)}"
    elif first["type"] == "literal_error":
        known = [word.strip().strip("'") for word in context["expected"].replace(" or ", ",").split(",")]
        message = f"unknown `{plain_name(value)}`; {nearest_word(str(value), known)}"
    elif "list_type" in kinds and kinds & {"float_type", "float_parsing"}:
        message = f"must be a number or a list of numbers; got {short_repr(value)}"
    elif first["type"] in ("float_type", "float_parsing"):
        message = f"must be a number; got {short_repr(value)}"
    elif first["type"] == "list_type":
        message = f"must be a list; got {short_repr(value)}"
    elif first["type"] in LIMITS:
        sign, limit = LIMITS[first["type"]]
        message = f"must be {sign} {context[limit]:g}; got {short_repr(value)}"
    elif first["type"] in ("too_short", "too_long"):
        sign, limit = (">=", "min_length") if first["type"] == "too_short" else ("<=", "max_length")
        message = f"must have {sign} {count_noun(context[limit], 'entry', 'entries')}; got {short_repr(value)}"
    elif first["type"] in ("unknown_key", "unfit_number"):
        message = first["msg"]
    else:
        message = f"{first['msg'][0].lower()}{first['msg'][1:]}; got {short_repr(value)}"
    return DefinitionError(message, where=where)


def _path(mistake: Any, data: Any) -> str:
    """Path of an error in the file, without the names of union members that pydantic adds."""
    loc: tuple[int | str, ...] = mistake["loc"]
    absent = len(loc) - 1 if mistake["type"] == "missing" else -1
    return ".".join(str(loc[depth]) for depth in _depths_in(data, loc, 0, absent))


def _depths_in(node: Any, loc: tuple[int | str, ...], depth: int, absent: int) -> list[int]:
    """Return the depths in `loc`, from `depth` on, that are keys and indices of the file.

    - `absent`: depth of a missing key; -1 for none.
    """
    if depth == len(loc):
        return []
    part = loc[depth]
    is_key = isinstance(node, dict) and (part in node or depth == absent)
    is_index = isinstance(node, list) and isinstance(part, int) and part < len(node)
    others = _depths_in(node, loc, depth + 1, absent)
    if not is_key and not is_index:
        return others
    inner = node.get(part) if is_key else node[part]
    # A union member may have the name of a key, such as `between`: then only one way leads to the erroneous field.
    ways = [depth, *_depths_in(inner, loc, depth + 1, absent)], others
    return max(ways, key=lambda depths: (depths[-1:], len(depths)))
