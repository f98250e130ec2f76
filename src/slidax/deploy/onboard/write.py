"""Writes what every robot's program needs around the step."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from ..contents import Project
from ..members import Member
from ..text import render
from . import law, log, options, rehearsal
from .allowed import Allowed

FILES = ("path.h", "path.c", "follow.h", "follow.c", "pilot.h", "pilot.c")
"""In C, each with the law's prefix."""

HERE = "slidax.deploy.onboard"


def write_onboard(project: Project, allowed: Allowed, out: Path, programs: Iterable[ModuleType] = ()) -> None:
    """Writes reference, checks and their Python binding beside an exported step.

    - `project`: the step.
    - `allowed`: what the robot allows.
    - `out`: the folder, which is there; the step's own files are in its folder `law`.
    - `programs`: modules of ours that run without this package; they become programs there.
    """
    folder = out / "law"
    for name in FILES:
        text = render(f"{name}.j2", {"x": project, "o": allowed}, HERE)
        (folder / f"{project.prefix}_{name}").write_text(text, encoding="utf-8")
    (folder / "law.json").write_text(json.dumps(described(project, allowed), indent=1) + "\n", encoding="utf-8")
    for module in (law, log, options, rehearsal, *programs):
        (out / f"{module.__name__.rpartition('.')[2]}.py").write_text(standalone(module), encoding="utf-8")


def standalone(module: ModuleType) -> str:
    """A module's text as a file that stands beside those that it imports.

    - `module`: of which all relative imports are of such files.
    """
    text = inspect.getsource(module)
    return text.replace("from ..onboard.", "from ").replace("from .", "from ")


def described(project: Project, allowed: Allowed) -> dict[str, Any]:
    """The step's structures for languages that do not read C.

    - `project`: the step.
    - `allowed`: what the robot allows.
    """
    return {
        "name": project.name,
        "prefix": project.prefix,
        "title": project.title,
        "law": project.law,
        "real": project.real,
        "joints": len(project.joints),
        "units": [joint.q for joint in project.joints],
        "torque_units": [joint.tau for joint in project.joints],
        "period": project.period,
        "t1": project.t1,
        "delay": project.delay,
        "version": project.version,
        "structures": {
            "parameters": _members(project.parameters, project),
            "reference": _members(project.reference, project),
            "command": _members(project.outputs, project),
        },
        "conditions": [{"name": each.name, "bit": each.bit, "meaning": each.meaning} for each in project.conditions],
        "reasons": [{"name": each.name, "meaning": each.meaning, "stops": each.stops} for each in allowed.reasons],
        "phases": ["hold", "approach", "small", "widen", "motion", "rest", "follow"],
    }


def _members(these: list[Member], project: Project) -> list[dict[str, Any]]:
    return [
        {
            "name": each.name,
            "type": project.dialect.type(each.type),
            "size": each.size if each.shape else 0,
            "meaning": each.meaning,
        }
        for each in these
    ]
