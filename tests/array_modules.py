"""The modules whose arguments are checked while the tests run: those that write shapes of arrays."""

from __future__ import annotations

import re
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "slidax"

SHAPES = re.compile(r"\b(Float|Bool|Int)\[|\b(Vector|Matrix|Scalar|PerJoint)\b")


def names() -> list[str]:
    """Each by its full name; mypy, which cannot see shapes, checks the others.

    Not codegen: it works on numbers one by one, and to check the arguments of every call takes ten times as long as it.
    A package is not in it, as all that is below it would be checked as well.
    """
    modules = []
    for path in sorted(SOURCE.rglob("*.py")):
        inside = path.relative_to(SOURCE).with_suffix("").parts
        if inside[0] != "codegen" and path.stem != "__init__" and SHAPES.search(path.read_text(encoding="utf-8")):
            modules.append(".".join(("slidax", *inside)))
    return modules
