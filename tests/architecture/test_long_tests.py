"""The list of long tests (`make verify`) and that of daily tests contain existing tests only."""

import ast
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

TESTS = Path(__file__).parents[1]
SCRIPT = TESTS.parent / "scripts" / "write-long-tests"


def names_of_tests():
    """Each test function as pytest writes it, without parameters."""
    for path in TESTS.rglob("test_*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield f"{path.relative_to(TESTS.parent).as_posix()}::{node.name}"


def test_lists_of_long_and_daily_tests_contain_existing_tests_only():
    loader = SourceFileLoader("write_long_tests", str(SCRIPT))
    script = module_from_spec(spec_from_loader(loader.name, loader))
    loader.exec_module(script)
    names = list(names_of_tests())
    long = (line for line in script.TARGET.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    assert [line for line in long if line.partition("[")[0] not in names] == []
    assert [start for start in script.ALWAYS if not any(f"/{start.partition('[')[0]}" in name for name in names)] == []
