"""Rules of the package: layers, import cycles, file lengths, docstrings, checked shapes, side effects of imports."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import is_dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

import slidax
from slidax.core import AbstractPart, vector_norm
from tests import array_modules

SOURCE = Path(slidax.__file__).parent
ROOT = SOURCE.parents[1]
TESTS = Path(__file__).parents[1]
MODULES = sorted(SOURCE.rglob("*.py"))
LONGEST = 500
ROOMS = sorted(path.parent.name for path in SOURCE.glob("*/__init__.py"))
PACKAGES = sorted(".".join(path.parent.relative_to(SOURCE).parts) for path in SOURCE.glob("*/**/__init__.py"))
"""The subpackages, and the packages inside them that have their own list of exports."""


def in_a_fresh_interpreter(code, folder=None):
    # Importing slidax has set this variable, and a child process would inherit it.
    inherited = {name: value for name, value in os.environ.items() if name != "JAX_ENABLE_X64"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=inherited | {"PYTHONPATH": os.pathsep.join([str(SOURCE.parent), str(TESTS.parent)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_imports_follow_the_layers_of_the_subpackages():
    """The contract is in pyproject.toml, read by import-linter."""
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"
    assert "KEPT" in in_a_fresh_interpreter(code, ROOT)


def paths_with_errors(paths, wrong):
    """Return the paths whose text is wrong. A single test over all paths is 100 times as fast as a test for each."""
    return [str(path) for path in paths if wrong(path.read_text(encoding="utf-8"))]


@pytest.mark.parametrize("folder", ["src", "tests", "scripts", "benchmarks", "examples"])
def test_no_module_is_longer_than_500_lines(folder):
    paths = sorted((ROOT / folder).rglob("*.py"))
    assert paths and not paths_with_errors(paths, lambda text: len(text.splitlines()) > LONGEST)


def test_every_module_has_a_docstring():
    assert MODULES and not paths_with_errors(MODULES, lambda text: not text.startswith('"""'))


def public(room):
    module = importlib.import_module(f"slidax.{room}")
    for name, thing in sorted(vars(module).items()):
        of_slidax = getattr(thing, "__module__", "") or ""
        if not name.startswith("_") and of_slidax.startswith("slidax.") and callable(thing):
            yield name, thing


def documented(room):
    for _, thing in public(room):
        yield thing
        if inspect.isclass(thing):
            for member, function in sorted(vars(thing).items()):
                if inspect.isfunction(function) and (not member.startswith("_") or member == "__call__"):
                    yield function


def known_names(thing):
    """Return the names that a list in a docstring may have: parameters, and a class's attributes and fields."""
    of = thing.__init__ if inspect.isclass(thing) and issubclass(thing, Exception) else thing
    names = list(inspect.signature(of).parameters)
    return [*names, *dir(thing), *getattr(thing, "__annotations__", ())] if inspect.isclass(thing) else names


@pytest.mark.parametrize("room", PACKAGES)
def test_public_functions_and_classes_have_docstrings_that_list_existing_parameters(room):
    """A method may inherit the docstring of the method that it implements. Obvious arguments need no line."""
    wrong = {}
    for thing in documented(room):
        if not (inspect.isfunction(thing) or inspect.isclass(thing)):
            continue
        text = inspect.getdoc(thing)
        listed = re.findall(r"^- ((?:`\w+`(?:, | and )?)+):", text or "", re.M)
        stale = {name for names in listed for name in re.findall(r"`(\w+)`", names)} - set(known_names(thing))
        if stale or not text:
            wrong[thing.__qualname__] = sorted(stale) or "no docstring"
    assert not wrong


def test_public_functions_accept_a_path_as_a_string():
    """Check the annotations; mypy checks the bodies against them."""
    narrow = [
        f"{thing.__qualname__}({name})"
        for room in PACKAGES
        for thing in documented(room)
        if not is_dataclass(thing)
        for name, kind in getattr(thing if inspect.isfunction(thing) else thing.__init__, "__annotations__", {}).items()
        if name != "return" and re.search(r"\bPath\b", str(kind)) and not re.search(r"\bstr\b", str(kind))
    ]
    assert not narrow


@pytest.mark.parametrize("room", PACKAGES)
def test_classes_are_abstract_or_final(room):
    """No class inherits from a concrete class, except errors."""
    for _, thing in public(room):
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            ancestors = [a for a in thing.__mro__[1:] if a.__module__.startswith("slidax.")]
            assert all(a.__name__.startswith("Abstract") for a in ancestors), thing


def test_no_module_uses_a_star_import():
    assert not paths_with_errors(MODULES, lambda text: "import *" in text)


def enrolled_kinds():
    kinds = set()
    for path in TESTS.rglob("members.py"):
        members = importlib.import_module(".".join(("tests", *path.relative_to(TESTS).with_suffix("").parts)))
        for value in vars(members).values():
            if isinstance(value, list):
                kinds |= {type(getattr(member, "controller", member)) for _, member in value}
    return kinds


@pytest.mark.parametrize("room", ["arms", "law", "motions", "plant"])
def test_every_arm_law_motion_and_plant_class_is_listed_in_members_py(room):
    """Every concrete class needs its line in a `members.py` of the tests."""
    enrolled = enrolled_kinds()
    bases = {a for kind in enrolled for a in kind.__mro__[1:] if a.__name__.startswith("Abstract")} - {AbstractPart}
    family = {
        thing
        for _, thing in public(room)
        if inspect.isclass(thing) and not inspect.isabstract(thing) and bases & set(thing.__mro__[1:])
    }
    assert family and not family - enrolled


def test_architecture_tests_cover_all_19_subpackages():
    assert {"arms", "codegen", "core", "law", "scenarios", "report", "paper", "export"} <= set(ROOMS)
    assert len(ROOMS) == 19 and {"codegen.trace", "law.sampled", "report.figures"} <= set(PACKAGES)


DRAWING = {"analysis", "certify", "cli", "design", "export", "paper", "report", "scenarios", "studies", "studio"}
"""Subpackages that need further packages to read files, to draw or to write pages."""


@pytest.mark.parametrize("rooms", [ROOMS, sorted(set(ROOMS) - DRAWING)], ids=["all", "without files and figures"])
def test_import_changes_only_the_64_bit_setting_and_loads_no_heavy_package(rooms):
    code = "import sys, jax\nbefore = {**jax.config.values, 'jax_enable_x64': True}\n"
    code += "".join(f"import slidax.{room}\n" for room in rooms)
    code += "assert dict(jax.config.values) == before\n"
    code += "print(*sorted(set(m.split('.')[0] for m in sys.modules)))"
    loaded = set(in_a_fresh_interpreter(code).split())
    heavy = {"diffrax", "pandas", "mujoco", "llvmlite", "viser", "pyarrow", "ruckig"}
    assert not loaded & (heavy if rooms == ROOMS else heavy | {"matplotlib", "rich", "pydantic", "jinja2"})


@pytest.mark.parametrize(
    ("first", "bits"),
    [
        ("import slidax, jax", 64),
        ("import jax, slidax", 64),
        ("import jax\njax.numpy.zeros(1)\nimport slidax", 64),
        ("import jax\nkept = jax.numpy.zeros(1)\nimport slidax", 32),
        ("import os\nos.environ['JAX_ENABLE_X64'] = '0'\nimport slidax, jax", 32),
    ],
)
def test_import_enables_64_bits_unless_arrays_exist_or_it_is_disabled(first, bits):
    assert in_a_fresh_interpreter(f"{first}\nprint(jax.numpy.ones(1).dtype)").strip() == f"float{bits}"


def test_run_with_32_bit_numbers_is_refused_with_a_one_line_remedy():
    code = """
import os
os.environ["JAX_ENABLE_X64"] = "0"
from slidax.core.errors import DefinitionError
from slidax.simulation import simulate
from tests.paper_examples import MOTION_4_1, START_4_1, law_4_1, plant_4_1
try:
    simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=0.01, period=1e-3)
except DefinitionError as error:
    print(error)
"""
    assert 'jax.config.update("jax_enable_x64", True)' in in_a_fresh_interpreter(code)


def test_32_bit_numbers_are_refused_by_states_certificates_and_designs():
    code = """
import os
os.environ["JAX_ENABLE_X64"] = "0"
import numpy as np
from slidax.core.errors import DefinitionError
from slidax.certify import certify
from slidax.design import design, read_problem
from slidax.scenarios import load
from slidax.simulation.states import states_of
from tests.paper_examples import plant_4_1
problem = read_problem("examples/design/two-link.yaml")
scenario, robot = load("example-4.1"), plant_4_1().robot
for compute in (lambda: states_of(robot, np.zeros((1, 2))), lambda: certify(scenario), lambda: design(problem)):
    try:
        compute()
    except DefinitionError as error:
        print(error)
"""
    assert in_a_fresh_interpreter(code).count('jax.config.update("jax_enable_x64", True)') == 3


def test_slidax_metrics_and_slidax_figures_are_shortcuts_to_their_packages():
    assert slidax.metrics.settling_time is importlib.import_module("slidax.analysis").settling_time
    assert slidax.figures.tracking_error is importlib.import_module("slidax.report.figures").tracking_error


def modules() -> dict[str, ast.Module]:
    return {
        ".".join(("slidax", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__"): ast.parse(
            path.read_text(encoding="utf-8")
        )
        for path in sorted(SOURCE.rglob("*.py"))
    }


def imports(node: ast.AST) -> Iterator[ast.ImportFrom]:
    """All imports except those for type checkers only."""
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


def test_no_modules_import_each_other_in_a_circle():
    trees = modules()
    packages = {name for name in trees if (SOURCE.parent / name.replace(".", "/") / "__init__.py").exists()}
    plain = set(trees) - packages
    graph = {name: imported(name, trees, packages) & plain for name in plain}
    assert len(plain) > 250 and sum(map(len, graph.values())) > 1000
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"import cycle: {' <- '.join(error.args[1])}")


def test_array_shapes_are_checked_in_every_module_that_annotates_them():
    names = set(array_modules.names())
    writes = {
        ".".join(("slidax", *path.relative_to(array_modules.SOURCE).with_suffix("").parts))
        for path in array_modules.SOURCE.rglob("*.py")
        if "from jaxtyping import" in (text := path.read_text(encoding="utf-8")) and "Float[" in text
    }
    assert {name for name in writes if not name.startswith("slidax.codegen.")} <= names
    assert "slidax.core.powers" in names


def test_argument_of_wrong_shape_raises_a_type_check_error():
    with pytest.raises(TypeCheckError):
        vector_norm(jnp.zeros((2, 2)))
