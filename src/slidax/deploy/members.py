"""Arrays of a tree as the members of a C structure: name, type, length, meaning and default."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from slidax._errors import DefinitionError
from slidax.codegen.ir import Type
from slidax.codegen.naming import identifier
from slidax.codegen.trace.trace import ir_type

from .comment_text import comment, shortened


@dataclass(frozen=True)
class Member:
    """One member of a structure.

    - `name`: in C.
    - `type`: of its numbers, as in the IR.
    - `shape`: () for one number; anything else becomes a flat array.
    - `meaning`: a few words with the unit, from the docstring of its class.
    - `part`: the first words of that docstring.
    - `values`: its default; None if it has none.
    """

    name: str
    type: Type
    shape: tuple[int, ...]
    meaning: str = ""
    part: str = ""
    values: np.ndarray | None = None

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))

    @property
    def brackets(self) -> str:
        """The array size after the name in its declaration."""
        return f"[{self.size}]" if self.shape else ""

    def element(self, k: int) -> str:
        """The name of the number at index `k`, in C order."""
        return f"{self.name}[{k}]" if self.shape else self.name


def members(tree: Any, *, strip: Sequence[str] = (), values: bool = False) -> list[Member]:
    """Return a member for each array in a tree, in the order of its leaves.

    - `tree`: a module with arrays, or their shapes.
    - `strip`: leading path parts to omit from names.
    - `values`: True if the arrays are defaults.

    Raises DefinitionError if two would have one name.
    """
    structure = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        parts = [_part(key) for key in path]
        while len(parts) > 1 and parts[0] in strip:
            parts = parts[1:]
        structure.append(
            Member(
                name=identifier("_".join(parts)),
                type=ir_type(leaf.dtype, ".".join(parts)),
                shape=tuple(leaf.shape),
                meaning=_meaning(tree, path),
                part=_part_of(tree, path),
                values=np.asarray(leaf) if values else None,
            )
        )
    names = [member.name for member in structure]
    for name in names:
        if names.count(name) > 1:
            raise DefinitionError(f"two arrays have the name `{name}` in C: rename the field of one of them")
    return structure


def _part(key: Any) -> str:
    for field in ("name", "key", "idx"):
        if hasattr(key, field):
            return str(getattr(key, field))
    raise DefinitionError(f"`{key}` has no name in C; use modules, tuples, lists and dictionaries")


def _meaning(tree: Any, path: Sequence[Any]) -> str:
    """The bullet of the innermost field on the way to the leaf, without words that the declaration repeats."""
    meaning = ""
    for place, key in way(tree, path):
        if hasattr(key, "name"):
            meaning = bullets(type(place)).get(key.name, meaning)
    for repeated in (
        r"; [^;]* if not given\.?$",
        r"; None.*",
        r"one number( or \[n\])?(, )?",
        r",? ?\[n\](?=[,;:.]|$)",
    ):
        meaning = re.sub(repeated, "", meaning)
    meaning = meaning.strip(", ")
    return shortened(comment(meaning), 92)


def _part_of(tree: Any, path: Sequence[Any]) -> str:
    """The first sentence about the innermost object that has the leaf."""
    owners = [place for place, key in way(tree, path) if hasattr(key, "name")]
    if not owners:
        return ""
    name = type(owners[-1]).__name__
    first = (inspect.getdoc(type(owners[-1])) or "").split("\n\n")[0]
    return f"{name}: {shortened(comment(' '.join(first.split())), 108 - len(name))}"


def way(tree: Any, path: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """The objects on the way to a leaf, each with the key that leads on."""
    place = tree
    for key in path:
        yield place, key
        name = _part(key)
        place = getattr(place, name) if hasattr(key, "name") else place[getattr(key, "key", getattr(key, "idx", name))]


def bullets(owner: type) -> dict[str, str]:
    """The bullets about fields in a class's docstring, in one line each."""
    meanings: dict[str, str] = {}
    for bullet in re.findall(r"^- ((?:.+\n?(?!- |\n))+.*)", inspect.getdoc(owner) or "", re.MULTILINE):
        names, colon, text = bullet.partition(":")
        if colon:
            meanings |= {name: " ".join(text.split()) for name in re.findall(r"`(\w+)`", names)}
    return meanings
