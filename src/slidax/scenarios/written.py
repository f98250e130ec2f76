"""Write descriptions as YAML."""

from __future__ import annotations

import io
from collections.abc import Iterable
from textwrap import fill
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from .base import AbstractDescription


def as_yaml(description: AbstractDescription) -> str:
    """Return a scenario or a study with all its values as YAML that can be run again."""
    return dumped(_shown(description))


def dumped(values: Any, width: int = 100) -> str:
    """Return mappings, lists and single values as YAML, in lines of about `width` characters."""
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = width
    text = io.StringIO()
    yaml.dump(values, text)
    return text.getvalue()


def dump_commented(values: Any, comments: Iterable[tuple[str, str]]) -> str:
    """Return a mapping as YAML with comments, and an empty line before each of its keys.

    - `comments`: the path of a key, such as `scheme.bound`, and the comment before it; skipped if the key is missing.
      Lines that start with `- ` are items of a list.
    """
    document = _commentable(values)
    for name in list(document)[1:]:
        document.yaml_set_comment_before_after_key(name, before="\n")
    for path, text in comments:
        *place, name = path.split(".")
        block, indent = document, 2 * len(place)
        for key in place:
            block = block.get(key, {})
        if name in block:
            block.yaml_set_comment_before_after_key(name, before=_filled(text, 116 - indent), indent=indent)
    return dumped(document, 116)


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
    """Plain values without null, except where null differs from the default."""
    if isinstance(value, AbstractDescription):
        defaults = {name: field.default for name, field in type(value).model_fields.items()}
        return {name: _shown(part) for name, part in value if part is not None or defaults[name] is not None}
    if isinstance(value, dict):
        return {name: _shown(part) for name, part in value.items()}
    return [_shown(part) for part in value] if isinstance(value, list | tuple) else value
