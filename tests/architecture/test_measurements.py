"""Benchmarks and scripts import only existing names; tests run few of them."""

import ast
import importlib
import importlib.util
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = sorted(path for folder in ("benchmarks", "scripts") for path in (ROOT / folder).rglob("*.py"))
OURS = ("slidax", "tests", "benchmarks")


def exists(module: str, name: str) -> bool:
    """True if a module has the name; also if the module itself needs a package that is not installed."""
    try:
        if hasattr(importlib.import_module(module), name):
            return True
    except ModuleNotFoundError as error:
        return error.name is not None and error.name.split(".")[0] not in OURS
    return importlib.util.find_spec(f"{module}.{name}") is not None


def test_benchmarks_and_scripts_import_existing_names_only():
    missing = []
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and not node.level and str(node.module).split(".")[0] in OURS:
                names = [alias.name for alias in node.names if not exists(str(node.module), alias.name)]
                missing += [f"{path.relative_to(ROOT)}, line {node.lineno}: {node.module}.{name}" for name in names]
    assert not missing


def test_every_measurement_of_scripts_measure_names_an_existing_function():
    command = (ROOT / "scripts" / "measure").read_text(encoding="utf-8")
    places = re.findall(r'^    "[\w-]+": "(\w+)\.(\w+)",$', command, re.MULTILINE)
    assert len(places) > 40
    for module, function in places:
        text = (ROOT / "scripts" / "figures" / f"{module}.py").read_text(encoding="utf-8")
        assert f"\ndef {function}(" in text, f"{module}.{function}"
