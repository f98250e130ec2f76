"""YAML text as values, within limits that no scenario comes near."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from slidax._errors import DefinitionError, shown
from slidax._files import read_text

MOST_CHARACTERS = 250_000
"""Of a text: the reader takes some ten seconds for so much of the densest YAML."""

MOST_VALUES = 250_000
"""In a text once its aliases are written out, with which a few lines could say more than any memory holds."""

DEEPEST = 50
"""Levels of lists and mappings in each other."""

LONG = "long motions belong in a file of their own, such as `trajectory: {kind: csv, file: motion.csv}`"


def text_of(path: Path, what: str = "the file") -> str:
    """The text in a file.

    - `path`: of the file.
    - `what`: what it is called in a message.

    Raises DefinitionError if it cannot be read.
    """
    return read_text(path, what)


def read_yaml_file(path: Path, what: str = "the file") -> Any:
    """The value in a YAML file.

    - `path`: of the file.
    - `what`: what it is called in a message.

    Raises DefinitionError, with the file and the line, if it cannot be read, is not YAML, or is too much of it.
    """
    text = text_of(path, what)
    try:
        return read_yaml(text)
    except DefinitionError as error:
        raise DefinitionError(f"{what} `{path}`: {error}") from None


def read_yaml(text: str) -> Any:
    """The value in a YAML 1.2 text.

    - `text`: YAML.

    Raises DefinitionError, with the line where there is one, if it is not YAML, or too much of it.
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
    # Where a value does not fit its tag, as in `!!float ""` or a 13th month, the reader fails as Python does.
    except (ValueError, LookupError, TypeError, AttributeError, AssertionError) as error:
        raise DefinitionError(f"not valid YAML: a value is not what its tag or form says: {error}") from None
    require_readable(value)
    return value


def require_readable(value: Any) -> None:
    """Raises DefinitionError if a value holds itself, is too large or too deep, or has a key that is no text.

    - `value`: mappings, lists and single values.
    """
    _size(value, {}, set(), DEEPEST)


def _size(value: Any, known: dict[int, int], inside: set[int], left: int) -> int:
    """How many values there are in one, itself included, each alias counted as what it stands for."""
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
