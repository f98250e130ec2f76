"""A playground: arms, schemes and programs together, as a page reads them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import slidax

from .arm import arm_entry
from .setting import Made, Setting

FORMAT = 1


NOTHING: dict[str, Any] = {"c_files": None, "c_parameters": None, "certificates": []}


def playground(
    title: str, settings: Sequence[Setting], arms: dict[str, str], *, promised: bool = True
) -> dict[str, Any]:
    """The manifest of a page.

    - `title`: of the page.
    - `settings`: what there is; the first is shown first.
    - `arms`: titles of the arms, by their labels.
    - `promised`: whether the law in C and its certificates come along, which take longer than all else.

    Raises DefinitionError if a setting is invalid or cannot run in a page.
    """
    made = [setting.made() for setting in settings]
    programs = {program.entry["id"]: dict(program.entry) for one in made for _, program in one.programs}
    first = settings[0]
    return {
        "format": FORMAT,
        "title": title,
        "made_by": f"slidax {slidax.__version__}",
        "first": {"arm": first.arm, "scheme": first.scheme},
        "arms": [_arm(label, name, made) for label, name in arms.items()],
        "programs": list(programs.values()),
        "settings": [{**one.entry(), **(one.beside() if promised else NOTHING)} for one in made],
    }


def _arm(label: str, title: str, made: Sequence[Made]) -> dict[str, Any]:
    built = next(one for one in made if one.setting.arm == label).templates.built
    limits = getattr(built.plant.actuator, "limits", None)
    torque, rate = (np.inf, np.inf) if limits is None else (limits.torque, limits.rate)
    return arm_entry(built.plant.robot, label, title, torque, rate, built.trajectory, built.t1)
