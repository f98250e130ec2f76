"""No module needs itself to be read, not even by an import inside of a function."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import slidax

SOURCE = Path(slidax.__file__).parent
MODULES = {
    ".".join(("slidax", *path.relative_to(SOURCE).with_suffix("").parts)): path for path in sorted(SOURCE.rglob("*.py"))
}


def imported(name: str, path: Path) -> set[str]:
    """The modules of this package that one names; a package's own list of exports counts as what it exports."""
    found = set()
    package = name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *filter(None, [node.module])])
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return found & set(MODULES)


@pytest.mark.parametrize("room", ["robots", "views"])
def test_the_modules_of_a_room_need_each_other_in_one_direction(room: str) -> None:
    names = [name for name in MODULES if name.startswith(f"slidax.{room}.") and not name.endswith("__init__")]
    try:
        list(TopologicalSorter({name: imported(name, MODULES[name]) & set(names) for name in names}).static_order())
    except CycleError as error:
        pytest.fail(f"a circle: {' <- '.join(error.args[1])}")
