"""Read YAML text within limits that no real scenario reaches."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from slidax._errors import DefinitionError, shown
from slidax._files import read_text

MOST_CHARACTERS = 250_000
"""Longest text: the reader takes ten seconds for the densest YAML of this length."""

MOST_VALUES = 250_000
"""Largest number of values with all aliases expanded; a few lines could otherwise exceed any memory."""

DEEPEST = 50
"""Largest depth of nested lists and mappings."""

LONG = "long motions belong in a file of their own, such as `trajectory: {kind: csv, file: motion.csv}`"


def text_of(path: Path, what: str = "the file") -> str:
    """Read the text in a file; `what` is its name in messages.

    Raises DefinitionError if it cannot be read.
    """
    return read_text(path, what)


def read_yaml_file(path: Path, what: str = "the file") -> Any:
    """Read the value in a YAML file; `what` is its name in messages.

    Raises DefinitionError, with the file and the line, if it cannot be read, is not YAML, or is too large.
    """
    text = text_of(path, what)
    try:
        return read_yaml(text)
    except DefinitionError as error:
        raise DefinitionError(f"{what} `{path}`: {error}") from None


def read_yaml(text: str) -> Any:
    """Return the value in a YAML 1.2 text.

    Raises DefinitionError, with the line if known, if it is not YAML, or is too large.
    """
    if len(text) > MOST_CHARACTERS:
        raise DefinitionError(f"the YAML has {len(text)} characters, at most {MOST_CHARACTERS} are read; {LONG}")
    try:
        value = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark else ""
        raise DefinitionError(f"not valid YAML{line}: {getattr(error, 'problem', None) or error}") from None
    except RecursionError:
        raise _too_deep() from None
    # The reader raises Python's own errors for a value that does not fit its tag, as in `!!float ""` or a 13th month.
    except (ValueError, LookupError, TypeError, AttributeError, AssertionError) as error:
        raise DefinitionError(f"not valid YAML: a value is not what its tag or form says: {error}") from None
    require_readable(value)
    return value


def require_readable(value: Any) -> None:
    """Raise DefinitionError if a value contains itself, is too large or too deep, or has a key that is no text."""
    _size(value, {}, set(), DEEPEST)


def _size(value: Any, known: dict[int, int], inside: set[int], left: int) -> int:
    """Number of values in a value, itself included, with all aliases expanded."""
    if not isinstance(value, (dict, list)):
        return 1
    if id(value) in known:
        return known[id(value)]
    if id(value) in inside:
        raise DefinitionError("an alias in the YAML stands for a value that it is part of")
    if not left:
        raise _too_deep()
    for key in value if isinstance(value, dict) else ():
        if not isinstance(key, str):
            raise DefinitionError(f"a key must be text; got `{shown(key)}`: write it in quotation marks")
    inside.add(id(value))
    parts: Iterable[Any] = value.values() if isinstance(value, dict) else value
    size = 1 + sum(_size(part, known, inside, left - 1) for part in parts)
    inside.remove(id(value))
    if size > MOST_VALUES:
        raise DefinitionError(f"the YAML has more than {MOST_VALUES} values with its aliases written out; {LONG}")
    known[id(value)] = size
    return size


def _too_deep() -> DefinitionError:
    return DefinitionError(f"the YAML has more than {DEEPEST} levels of lists and mappings")
