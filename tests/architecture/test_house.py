"""The rules of the house: floors, sizes, words and quiet imports."""

import importlib
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import slidax
from slidax.parts import AbstractPart

SOURCE = Path(slidax.__file__).parent
ROOT = SOURCE.parents[1]
TESTS = Path(__file__).parents[1]
MODULES = sorted(SOURCE.rglob("*.py"))
LONGEST = 300
ROOMS = [
    "numerics",
    "trajectories",
    "robots",
    "disturbances",
    "sensors",
    "actuators",
    "performance",
    "transformations",
    "surfaces",
    "reaching",
    "estimators",
    "controllers",
    "simulation",
]


def test_imports_go_down_the_floors_only():
    """The contract is in pyproject.toml, read by import-linter."""
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(SOURCE.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "KEPT" in done.stdout


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_no_module_is_longer_than_a_person_reads_at_once(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_no_test_module_is_either():
    long = [str(path) for path in TESTS.rglob("*.py") if len(path.read_text(encoding="utf-8").splitlines()) > LONGEST]
    assert not long


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_every_module_says_what_it_is(path):
    assert path.read_text(encoding="utf-8").startswith('"""')


def public(room):
    module = importlib.import_module(f"slidax.{room}")
    for name, thing in sorted(vars(module).items()):
        of_slidax = getattr(thing, "__module__", "") or ""
        if not name.startswith("_") and of_slidax.startswith("slidax.") and callable(thing):
            yield name, thing


def documented():
    for room in ROOMS:
        for name, thing in public(room):
            yield pytest.param(thing, id=f"{room}.{name}")
            if inspect.isclass(thing):
                for member, function in sorted(vars(thing).items()):
                    if inspect.isfunction(function) and (not member.startswith("_") or member == "__call__"):
                        yield pytest.param(function, id=f"{room}.{name}.{member}")


def words(text):
    """The names in backticks, also inside of formulas and lists of names."""
    return set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]*)`", text or ""))))


def arguments(thing):
    """What a caller gives: a class's fields or `__init__` arguments, a function's parameters."""
    if inspect.isclass(thing) and inspect.isabstract(thing):
        return []
    try:
        names = list(inspect.signature(thing).parameters)
    except ValueError:
        return []
    return [name for name in names if name not in ("self", "args", "kwargs")]


@pytest.mark.parametrize("thing", list(documented()))
def test_every_argument_is_named_in_its_docstring(thing):
    """In the docstring itself, or for a method in that of the method it fulfils."""
    missing = set(arguments(thing)) - words(inspect.getdoc(thing))
    assert inspect.getdoc(thing)
    assert not missing, f"{thing.__qualname__} does not explain {sorted(missing)}"


@pytest.mark.parametrize("room", ROOMS)
def test_classes_are_abstract_or_final(room):
    """Nothing that can be made is inherited from: each concrete class has only abstract ancestors in the package."""
    for _, thing in public(room):
        if inspect.isclass(thing):
            ancestors = [a for a in thing.__mro__[1:] if a.__module__.startswith("slidax.")]
            assert all(a.__name__.startswith("Abstract") for a in ancestors), thing


@pytest.mark.parametrize("room", ROOMS)
def test_what_a_room_exports_it_exports_by_name(room):
    for path in (SOURCE / room).glob("*.py"):
        assert "import *" not in path.read_text(encoding="utf-8")


def enrolled_kinds(room):
    members = importlib.import_module(f"tests.{room}.members")
    found = []
    for value in vars(members).values():
        if isinstance(value, list):
            found += [getattr(member, "controller", member) for _, member in value]
    return {type(member) for member in found}


@pytest.mark.parametrize("room", [room for room in ROOMS if (TESTS / room / "members.py").exists()])
def test_every_member_of_a_room_is_enrolled_in_the_law_tests(room):
    """Whoever adds a member and forgets its line in `members.py` is told so here."""
    family = [
        thing
        for _, thing in public(room)
        if inspect.isclass(thing)
        and not inspect.isabstract(thing)
        and any(a.__name__.startswith("Abstract") for a in thing.__mro__[1:] if a is not AbstractPart)
    ]
    assert family
    assert set(family) <= enrolled_kinds(room)


def in_a_fresh_interpreter(code):
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(SOURCE.parent), str(TESTS.parent)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_slidax_sets_nothing_draws_nothing_and_solves_nothing():
    code = "import sys, jax\nbefore = dict(jax.config.values)\n"
    code += "".join(f"import slidax.{room}\n" for room in ROOMS)
    code += "assert dict(jax.config.values) == before\nassert not jax.config.jax_enable_x64\n"
    code += "print(*sorted(set(m.split('.')[0] for m in sys.modules)))"
    loaded = in_a_fresh_interpreter(code).split()
    assert not {"matplotlib", "diffrax", "rich", "pydantic", "pandas"} & set(loaded)


def test_without_64_bit_numbers_a_run_is_refused_with_the_one_line_remedy():
    code = """
from slidax._errors import DefinitionError
from slidax.simulation import simulate
from tests.paper import MOTION_4_1, START_4_1, law_4_1, plant_4_1
try:
    simulate(plant_4_1(), law_4_1(), MOTION_4_1, START_4_1, t1=0.01, period=1e-3)
except DefinitionError as error:
    print(error)
"""
    assert 'jax.config.update("jax_enable_x64", True)' in in_a_fresh_interpreter(code)
