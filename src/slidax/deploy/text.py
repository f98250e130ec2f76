"""Files of an exported project from templates."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from slidax.codegen.c import Dialect

from .comment_text import comment
from .members import Member


def render(template: str, values: dict[str, Any]) -> str:
    """Render a template, such as `step.c.j2` or `franka/main.cpp.j2`."""
    environment = Environment(
        loader=PackageLoader(str(__package__)),
        autoescape=False,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"comment": comment, "capitalised": _capitalised, "wrapped": _wrapped}
    environment.globals |= {
        "declarations": declarations,
        "initialisers": initialisers,
        "table_definitions": table_definitions,
    }
    return environment.get_template(template).render(values)


def declarations(members: Sequence[Member], dialect: Dialect) -> list[str]:
    """Lines that declare members with default and meaning in a comment, grouped by part."""
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
    """Lines that initialise members with their defaults."""
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
    """Lines that define constant arrays."""
    lines: list[str] = []
    for member in members:
        assert member.values is not None
        numbers = ", ".join(_number(number, member, dialect) for number in member.values.ravel())
        lines.append(f"static const {dialect.type(member.type)} {member.name}[{member.size}] = {{")
        lines += [f"    {row}" for row in textwrap.wrap(numbers, 100, break_long_words=False)]
        lines += ["};", ""]
    return lines


def default(member: Member, dialect: Dialect) -> str:
    """A member's default in short form; empty if it has none."""
    if member.values is None:
        return ""
    numbers = ["none" if np.isposinf(number) else _number(number, member, dialect) for number in member.values.ravel()]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)


def _number(number: Any, member: Member, dialect: Dialect) -> str:
    return dialect.number(number.item(), member.type)


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _wrapped(text: str, before: str, width: int = 116) -> str:
    """Wrap a paragraph, with a prefix on each line after the first."""
    return f"\n{before}".join(textwrap.wrap(text, width - len(before)))
