"""The files that every robot's program needs around the step, and the export for a robot with given joints and rate."""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError
from slidax._writing import write_text
from slidax.scenarios import Scenario

from ..contents import Project
from ..members import Member
from ..project import STEP, export_c, project, write_files, writing
from .allowed import Allowed
from .gravity import weight_by_robot
from .law import Pilot
from .log import Log
from .options import loaded
from .rehearsal import rehearse

C_FILES = ("path.h", "path.c", "follow.h", "follow.c", "pilot.h", "pilot.c", "words.c")
"""Files in C, each with the law's prefix."""


@dataclass(frozen=True)
class RobotTarget:
    """A robot that takes torques from an exported law, and carries its own weight.

    - `name`: in messages, with its article.
    - `joints`, `period`: number of joints, and sample time [s].
    - `lost`: missing samples in a row that end a motion.
    - `folder`, `files`: templates, and the files that they become.
    - `program`: entry point of the Python program that becomes `program.py`.
    """

    name: str
    joints: int
    period: float
    lost: int
    folder: str
    files: Mapping[str, str]
    program: Callable[..., Any]


def export_robot(
    target: RobotTarget,
    scenario: Scenario,
    out: Path,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    golden: bool = True,
) -> Project:
    """Write a robot's programs and the law that they run.

    - `name`, `single`, `command`: as in `export_c`.
    - `golden`: include the tests and golden samples, which take most of the time.

    Raises DefinitionError if the scenario has another number of joints or another period, or cannot be exported.
    """
    joints = scenario.state0.q.size
    if joints != target.joints:
        raise DefinitionError(f"{target.name} has {target.joints} joints; the robot of `{scenario.name}` has {joints}")
    if abs(scenario.period - target.period) > 1e-9:
        raise DefinitionError(
            f"`simulation.period` must be {target.period:g} s, the sample time of {target.name}; "
            f"got {scenario.period:g}: `--set simulation.period={1e3 * target.period:g}e-3`"
        )
    weightless = weight_by_robot(scenario)
    exported = write_law(weightless, out / "law", name=name, single=single, command=command, golden=golden)
    limits = Allowed.of(weightless, exported, lost=target.lost, carried=True)
    write_onboard(exported, limits, out, {"program.py": target.program})
    write_files(exported, out, {f"{target.folder}/{name}": file for name, file in target.files.items()}, o=limits)
    return exported


def write_law(scenario: Scenario, out: Path, *, name: str | None, single: bool, command: str, golden: bool) -> Project:
    """Write the step itself, with tests and golden samples if `golden`; the options are those of `export_c`."""
    if golden:
        return export_c(scenario, out, name=name, single=single, command=command)
    exported = project(scenario, name=name, single=single, command=command, with_golden=False)
    write_files(exported, out, STEP)
    return exported


def write_onboard(
    exported: Project,
    limits: Allowed,
    out: Path,
    programs: Mapping[str, Callable[..., Any]] | None = None,
    names: Sequence[str] = (),
) -> None:
    """Write reference, checks and their Python binding to `out`; the step is already in its folder `law`.

    - `programs`: more Python programs by file name, each by a function or class of its module.
    - `names`: joint names, for programs that address joints by name.

    Raises DefinitionError if the folder cannot be written.
    """
    folder = out / "law"
    write_files(exported, folder, {f"onboard/{name}.j2": f"{{prefix}}_{name}" for name in C_FILES}, o=limits)
    law = described(exported, limits) | ({"names": list(names)} if names else {})
    files: dict[str, Any] = {f"{_stem(part)}.py": part for part in (Pilot, Log, loaded, rehearse)}
    with writing(out):
        write_text(folder / "law.json", json.dumps(law, indent=1) + "\n")
        for file, part in {**files, **(programs or {})}.items():
            write_text(out / file, standalone(part))


def standalone(part: Any) -> str:
    """Source of the module that defines `part`, with package imports replaced by imports from the same folder."""
    text = inspect.getsource(sys.modules[part.__module__])
    return re.sub(r"^from (?:\.+|slidax\.)[\w.]*?(\w+) import", r"from \1 import", text, flags=re.MULTILINE)


def _stem(part: Any) -> str:
    name: str = part.__module__
    return name.rpartition(".")[2]


def described(exported: Project, limits: Allowed) -> dict[str, Any]:
    """The step's structures for languages that do not read C, as `law.json` has them."""
    return {
        "name": exported.name,
        "prefix": exported.prefix,
        "title": exported.title,
        "law": exported.law,
        "real": exported.real,
        "joints": len(exported.joints),
        "units": [joint.q for joint in exported.joints],
        "torque_units": [joint.tau for joint in exported.joints],
        "period": exported.period,
        "t1": exported.t1,
        "delay": exported.delay,
        "version": exported.version,
        "structures": {
            "parameters": _members(exported.parameters, exported),
            "reference": _members(exported.reference, exported),
            "command": _members(exported.outputs, exported),
        },
        "conditions": [{"name": each.name, "bit": each.bit, "meaning": each.meaning} for each in exported.conditions],
        "reasons": [{"name": each.name, "meaning": each.meaning, "stops": each.stops} for each in limits.reasons],
        "phases": ["hold", "approach", "small", "widen", "motion", "rest", "follow"],
    }


def _members(these: list[Member], exported: Project) -> list[dict[str, Any]]:
    return [
        {
            "name": each.name,
            "type": exported.dialect.type(each.type),
            "size": each.size if each.shape else 0,
            "meaning": each.meaning,
        }
        for each in these
    ]
