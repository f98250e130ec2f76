"""Writes what every robot's program needs around the step."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from slidax._writing import write_text
from slidax.scenarios import Scenario

from ..contents import Project
from ..members import Member
from ..project import STEP, export_c, project, write_files
from ..text import render
from . import law, log, options, rehearsal
from .allowed import Allowed

FILES = ("path.h", "path.c", "follow.h", "follow.c", "pilot.h", "pilot.c", "words.c")
"""In C, each with the law's prefix."""

HERE = "slidax.deploy.onboard"


def write_law(scenario: Scenario, out: Path, *, name: str | None, single: bool, command: str, golden: bool) -> Project:
    """Writes the step itself.

    - `scenario`: whose law.
    - `out`: the folder.
    - `name`, `single`, `command`: as in `export_c`.
    - `golden`: whether with its tests and golden samples, which take most of the time.

    Raises DefinitionError as `export_c` does.
    """
    if golden:
        return export_c(scenario, out, name=name, single=single, command=command)
    made = project(scenario, name=name, single=single, command=command, with_golden=False)
    write_files(made, out, STEP)
    return made


def write_onboard(
    made: Project, allowed: Allowed, out: Path, programs: Iterable[ModuleType] = (), names: Sequence[str] = ()
) -> None:
    """Writes reference, checks and their Python binding beside an exported step.

    - `made`: the step.
    - `allowed`: what the robot allows.
    - `out`: the folder, which is there; the step's own files are in its folder `law`.
    - `programs`: modules of ours that run without this package; they become programs there.
    - `names`: of the joints, for programs that find them by name.
    """
    folder = out / "law"
    for name in FILES:
        text = render(f"{name}.j2", {"x": made, "o": allowed}, HERE)
        write_text(folder / f"{made.prefix}_{name}", text)
    write_text(
        folder / "law.json",
        json.dumps(described(made, allowed) | ({"names": list(names)} if names else {}), indent=1) + "\n",
    )
    for module in (law, log, options, rehearsal, *programs):
        write_text(out / f"{module.__name__.rpartition('.')[2]}.py", standalone(module))


def standalone(module: ModuleType) -> str:
    """A module's text as a file that stands beside those that it imports.

    - `module`: of which all relative imports are of such files.
    """
    text = inspect.getsource(module)
    return text.replace("from ..onboard.", "from ").replace("from .", "from ")


def described(made: Project, allowed: Allowed) -> dict[str, Any]:
    """The step's structures for languages that do not read C.

    - `made`: the step.
    - `allowed`: what the robot allows.
    """
    return {
        "name": made.name,
        "prefix": made.prefix,
        "title": made.title,
        "law": made.law,
        "real": made.real,
        "joints": len(made.joints),
        "units": [joint.q for joint in made.joints],
        "torque_units": [joint.tau for joint in made.joints],
        "period": made.period,
        "t1": made.t1,
        "delay": made.delay,
        "version": made.version,
        "structures": {
            "parameters": _members(made.parameters, made),
            "reference": _members(made.reference, made),
            "command": _members(made.outputs, made),
        },
        "conditions": [{"name": each.name, "bit": each.bit, "meaning": each.meaning} for each in made.conditions],
        "reasons": [{"name": each.name, "meaning": each.meaning, "stops": each.stops} for each in allowed.reasons],
        "phases": ["hold", "approach", "small", "widen", "motion", "rest", "follow"],
    }


def _members(these: list[Member], made: Project) -> list[dict[str, Any]]:
    return [
        {
            "name": each.name,
            "type": made.dialect.type(each.type),
            "size": each.size if each.shape else 0,
            "meaning": each.meaning,
        }
        for each in these
    ]
