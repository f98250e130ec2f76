"""Manifest of a page: arms, schemes and programs together."""

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

    - `settings`: the first is shown first.
    - `arms`: titles of the arms, by their labels.
    - `promised`: include the law in C and its certificates, which take most of the time.

    Raises DefinitionError if a setting is invalid or cannot run in a page.
    """
    built = [setting.build() for setting in settings]
    programs = {program.entry["id"]: dict(program.entry) for setting in built for _, program in setting.programs}
    first = settings[0]
    return {
        "format": FORMAT,
        "title": title,
        "made_by": f"slidax {slidax.__version__}",
        "first": {"arm": first.arm, "scheme": first.scheme},
        "arms": [_arm(label, name, built) for label, name in arms.items()],
        "programs": list(programs.values()),
        "settings": [{**setting.entry(), **(setting.beside() if promised else NOTHING)} for setting in built],
    }


def _arm(label: str, title: str, settings: Sequence[Made]) -> dict[str, Any]:
    built = next(each for each in settings if each.setting.arm == label).templates.built
    limits = getattr(built.plant.actuator, "limits", None)
    torque, rate = (np.inf, np.inf) if limits is None else (limits.torque, limits.rate)
    return arm_entry(built.plant.robot, label, title, torque, rate, built.trajectory, built.t1)
