"""Members of the C structures for a step's parameters, memory and signals; valid ranges; text from templates."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from slidax.codegen.c.expressions import Dialect
from slidax.codegen.ir import Type
from slidax.codegen.naming.names import identifier
from slidax.codegen.naming.source_text import to_ascii
from slidax.codegen.trace.tracing import ir_type
from slidax.core.errors import DefinitionError
from slidax.core.parameter import Parameter, declaration, is_declared
from slidax.core.part import AbstractPart

from .status import Flag


def comment(text: str) -> str:
    """Return a text as it may stand inside a C comment: in ASCII, without backquotes and comment delimiters."""
    return to_ascii(text.replace("`", "")).replace("*/", "* /").replace("/*", "/ *")


def shorten(text: str, most: int) -> str:
    """Return the first sentence of a line, cut at a comma, semicolon or colon if it has more than `most` characters."""
    first = re.split(r"(?<!eq)(?<!eqs)\.(?: |$)", text, maxsplit=1)[0]
    if len(first) <= most:
        return first
    cut = max(first.rfind(mark, 0, most) for mark in (", ", "; ", ": "))
    return first[: cut if cut > 0 else most].rstrip(" ,;:")


@dataclass(frozen=True)
class Member:
    """One member of a C structure, which holds one array of a Python object.

    - `name`: name in C.
    - `type`: type of its numbers in `slidax.codegen.ir`, such as "f64".
    - `shape`: () for one number; any other shape becomes a flat array.
    - `meaning`: a few words with the unit, from the bullet for it in the docstring of the object's class.
    - `part`: name of this class, and first words of its docstring.
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
        """Array size after the name in the C declaration; empty for one number."""
        return f"[{self.size}]" if self.shape else ""

    def element(self, k: int) -> str:
        """Return the C expression of the number at the flat index `k`."""
        return f"{self.name}[{k}]" if self.shape else self.name


def members(tree: Any, *, strip: Sequence[str] = (), values: bool = False) -> list[Member]:
    """Return a structure member for each array in a tree, in the order of the tree's leaves.

    - `tree`: a module with arrays, or their shapes. A member is named by the path to its array: `surface_k1`.
    - `strip`: first keys of a path that the member's name omits.
    - `values`: True if the arrays are the members' defaults.

    Raises DefinitionError if two members would have the same name.
    """
    structure = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        parts = [_part_of_path(key) for key in path]
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


def _part_of_path(key: Any) -> str:
    """Return the name of one key of a tree path: a field, a dictionary key or an index."""
    for field in ("name", "key", "idx"):
        if hasattr(key, field):
            return str(getattr(key, field))
    raise DefinitionError(
        f"`{key}`, in the path to a parameter, has no name in C: keep arrays in modules, tuples, lists or dictionaries"
    )


def _meaning(tree: Any, path: Sequence[Any]) -> str:
    """Return the docstring bullet of the innermost field on the path to a leaf, without words that C repeats."""
    meaning = ""
    for place, key in _objects_on_path(tree, path):
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
    return shorten(comment(meaning), 92)


def _part_of(tree: Any, path: Sequence[Any]) -> str:
    """Return class name and first docstring sentence of the innermost object on the path to a leaf."""
    owners = [place for place, key in _objects_on_path(tree, path) if hasattr(key, "name")]
    if not owners:
        return ""
    name = type(owners[-1]).__name__
    first = (inspect.getdoc(type(owners[-1])) or "").split("\n\n")[0]
    return f"{name}: {shorten(comment(' '.join(first.split())), 108 - len(name))}"


def _objects_on_path(tree: Any, path: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield the objects on the path to a leaf, each with the key of the next object."""
    place = tree
    for key in path:
        yield place, key
        name = _part_of_path(key)
        place = getattr(place, name) if hasattr(key, "name") else place[getattr(key, "key", getattr(key, "idx", name))]


def bullets(owner: type) -> dict[str, str]:
    """Return the bullets of a class's docstring by field name, each as one line."""
    meanings: dict[str, str] = {}
    for bullet in re.findall(r"^- ((?:.+\n?(?!- |\n))+.*)", inspect.getdoc(owner) or "", re.MULTILINE):
        names, colon, text = bullet.partition(":")
        if colon:
            meanings |= {name: " ".join(text.split()) for name in re.findall(r"`(\w+)`", names)}
    return meanings


class ParameterBounds(NamedTuple):
    """Smallest and largest allowed value of an array's numbers; infinite if the parameter may be infinite."""

    low: float
    high: float


def constant_bounds(tree: Any, real: str) -> list[ParameterBounds | None]:
    """Return the bounds of each array in a tree, in the order of its leaves; None for integers and booleans.

    A bound itself is an allowed value. An open end of a declared range is therefore replaced by the next number of the
    C type `real` inside the range, or by the smallest normal number if the end is 0. The largest finite number replaces
    an infinite open end, and an end that depends on other parameters (see `related_valid`). It also bounds arrays
    without a declared range.
    """
    kind = np.float64 if real == "double" else np.float32
    largest, least = float(np.finfo(kind).max), float(np.finfo(kind).tiny)

    def closed(number: float | None, open_end: bool, outward: float) -> float:
        if number is None or (np.isinf(number) and open_end):
            return outward * largest
        if np.isinf(number) or not open_end:
            return number
        return -outward * least if number == 0.0 else float(np.nextafter(kind(number), kind(-outward * np.inf)))

    bounds: list[ParameterBounds | None] = []
    for _, parameter, leaf in declared_arrays(tree):
        if not jnp.issubdtype(leaf.dtype, jnp.inexact):
            bounds.append(None)
        elif parameter is None:
            bounds.append(ParameterBounds(-largest, largest))
        else:
            lower, upper = parameter.range.ends
            bounds.append(
                ParameterBounds(closed(lower.number, lower.open, -1.0), closed(upper.number, upper.open, 1.0))
            )
    return bounds


def related_valid(tree: Any) -> Flag:
    """True if all parameters in a tree satisfy those ends of their ranges that depend on other parameters."""
    conditions = []
    for part, parameter, value in declared_arrays(tree):
        if parameter is None or not jnp.issubdtype(value.dtype, jnp.inexact):
            continue
        for end, is_lower in zip(parameter.range.ends, (True, False), strict=True):
            if end.number is None:
                bound = end.value(part)
                smaller, larger = (bound, value) if is_lower else (value, bound)
                conditions.append(jnp.ravel(larger > smaller if end.open else larger >= smaller))
    return jnp.all(jnp.concatenate(conditions)) if conditions else jnp.ones((), bool)


def declared_arrays(tree: Any) -> Iterator[tuple[Any, Parameter | None, Any]]:
    """Yield, for each array in a tree, the object that has it, the parameter's declaration or None, and the array."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        owner, parameter = None, None
        for place, key in _objects_on_path(tree, path):
            # A pytree within a parameter, such as a tuple of arrays, belongs to the part that declares it.
            if isinstance(place, AbstractPart):
                field = next(field for field in place.__dataclass_fields__.values() if field.name == key.name)
                owner, parameter = place, declaration(field) if is_declared(field) else None
            elif hasattr(key, "name"):
                owner, parameter = place, None
        yield owner, None if parameter is None or parameter.piece else parameter, leaf


def render(template: str, values: dict[str, Any]) -> str:
    """Return the text of a template, such as `step.c.j2` or `franka/main.cpp.j2`, for the values of its variables."""
    environment = Environment(
        loader=PackageLoader(str(__package__)),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"comment": comment, "wrapped": _wrapped}
    environment.filters["capitalised"] = lambda text: text[:1].upper() + text[1:]
    environment.globals |= {each.__name__: each for each in (declarations, initialisers, table_definitions)}
    return environment.get_template(template).render(values)


def declarations(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """Return the C lines that declare members, grouped by `part`, each with its default and meaning as a comment."""
    lines: list[str] = []
    for part, group in groupby(members, key=lambda member: member.part):
        these = list(group)
        if part:
            lines += ([""] if lines else []) + [f"/* {part} */"]
        names = [f"{dialect.type(member.type)} {member.name}{member.brackets};" for member in these]
        width = max(map(len, names))
        for name, member in zip(names, these, strict=True):
            words = [default(member, dialect), member.meaning]
            remark = ": ".join(word for word in words if word)
            lines.append(f"{name:<{width}} /* {remark} */" if remark else name)
    return lines


def initialisers(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """Return the C lines that initialise members with their defaults."""
    lines: list[str] = []
    for member in members:
        if member.values is None:
            continue
        numbers = [_number(number, member, dialect) for number in member.values.ravel()]
        if not member.shape:
            lines.append(f".{member.name} = {numbers[0]},")
        else:
            rows = textwrap.wrap(f".{member.name} = {{{', '.join(numbers)}}},", 100, break_long_words=False)
            lines += [rows[0], *(f"    {row}" for row in rows[1:])]
    return lines


def table_definitions(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """Return the C lines that define members as constant arrays."""
    lines: list[str] = []
    for member in members:
        assert member.values is not None
        numbers = ", ".join(_number(number, member, dialect) for number in member.values.ravel())
        lines.append(f"static const {dialect.type(member.type)} {member.name}[{member.size}] = {{")
        lines += [f"    {row}" for row in textwrap.wrap(numbers, 100, break_long_words=False)]
        lines += ["};", ""]
    return lines


def default(member: Member, dialect: Dialect) -> str:
    """Return a member's default as a short text: a single number if all are equal; empty if it has no default."""
    if member.values is None:
        return ""
    numbers = ["none" if np.isposinf(number) else _number(number, member, dialect) for number in member.values.ravel()]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)


def _number(number: Any, member: Member, dialect: Dialect) -> str:
    return dialect.number(number.item(), member.type)


def _wrapped(text: str, before: str, width: int = 116) -> str:
    """Wrap a paragraph, with a prefix on each line after the first."""
    return f"\n{before}".join(textwrap.wrap(text, width - len(before)))
