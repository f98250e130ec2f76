"""No module needs itself to be read, not even by an import inside a function."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import slidax

SOURCE = Path(slidax.__file__).parent


def modules() -> dict[str, ast.Module]:
    return {
        ".".join(("slidax", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__"): ast.parse(
            path.read_text(encoding="utf-8")
        )
        for path in sorted(SOURCE.rglob("*.py"))
    }


def imports(node: ast.AST) -> Iterator[ast.ImportFrom]:
    """All imports except those for type checkers alone."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        if isinstance(child, ast.ImportFrom):
            yield child
        yield from imports(child)


def imported(name: str, trees: dict[str, ast.Module], packages: set[str]) -> set[str]:
    """The modules that a module imports from; a package stands for the modules whose names it exports."""
    needed = set()
    parts = name.split(".")
    package = parts if name in packages else parts[:-1]
    for node in imports(trees[name]):
        above = package[: len(package) - node.level + 1] if node.level else []
        base = ".".join([*above, *filter(None, [node.module])])
        for alias in node.names:
            inner = f"{base}.{alias.name}"
            if inner in trees:
                needed.add(inner)
            elif base in packages and base != name:
                needed |= {
                    ".".join([base, *filter(None, [export.module])])
                    for export in imports(trees[base])
                    if any((each.asname or each.name) == alias.name for each in export.names)
                }
            else:
                needed.add(base)
    return needed & set(trees) - {name}


def test_imports_have_one_direction() -> None:
    trees = modules()
    packages = {name for name in trees if (SOURCE.parent / name.replace(".", "/") / "__init__.py").exists()}
    plain = set(trees) - packages
    graph = {name: imported(name, trees, packages) & plain for name in plain}
    assert len(plain) > 250
    assert sum(map(len, graph.values())) > 1000
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"a circle: {' <- '.join(error.args[1])}")
