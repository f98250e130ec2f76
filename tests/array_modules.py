"""The modules whose arguments are checked while the tests run: those that write shapes of arrays."""

from __future__ import annotations

import re
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "slidax"

SHAPES = re.compile(r"\b(Float|Bool|Int)\[|\b(Vector|Matrix|Scalar|PerJoint)\b")


def names() -> list[str]:
    """Full names of the modules with shapes; mypy, which cannot see shapes, checks the others.

    Without codegen, which would take ten times as long with checked arguments. Without packages, because all modules
    of a package would be checked as well.
    """
    modules = []
    for path in sorted(SOURCE.rglob("*.py")):
        inside = path.relative_to(SOURCE).with_suffix("").parts
        if inside[0] != "codegen" and path.stem != "__init__" and SHAPES.search(path.read_text(encoding="utf-8")):
            modules.append(".".join(("slidax", *inside)))
    return modules
