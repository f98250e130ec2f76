"""Built-in arms, with data from manufacturers and published identifications: one YAML file each in `built_in_arms`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from slidax.core.errors import DefinitionError, nearest_word

from .articulated import Articulated
from .assemble import assemble
from .joint import Joint
from .rotations import rotation_by_roll_pitch_yaw

FILES = resources.files("slidax.arms") / "built_in_arms"


@dataclass(frozen=True)
class BuiltInArm:
    """A built-in arm with its manufacturer's data.

    - `robot`: the arm without friction.
    - `title`: full name.
    - `rate`: sampling rate of its command interface, 1/s.
    - `home`: typical posture [n], rad.
    - `sources`: source of each group of parameters.
    """

    robot: Articulated
    title: str
    rate: float
    home: tuple[float, ...]
    sources: dict[str, str]


def built_in_names() -> tuple[str, ...]:
    """Return the names of the built-in arms, from their file names."""
    return tuple(sorted(file.name.removesuffix(".yaml") for file in FILES.iterdir() if file.name.endswith(".yaml")))


def built_in_title(name: str) -> str:
    """Return a built-in arm's title, such as "Franka Emika Panda, 7 joints"."""
    # Parsing the whole file would take a hundred times as long.
    text = (FILES / f"{name}.yaml").read_text(encoding="utf-8")
    (title,) = re.findall(r"^title: (.+)$", text, re.MULTILINE)
    return f"{title}, {len(re.findall(r'^  - name: ', text, re.MULTILINE))} joints"


def built_in_arm(name: str) -> BuiltInArm:
    """Return a built-in arm by its name, such as `panda`.

    Raises DefinitionError for an unknown name.
    """
    data = _data(name)
    tip = data["tip"]
    joints = [_joint(entry) for entry in data["joints"]]
    flange = Joint(
        name=f"{tip['name']}_joint",
        kind="fixed",
        parent=tip["joint"],
        link=tip["name"],
        rotation=rotation_by_roll_pitch_yaw(tip["turn"]),
        translation=np.asarray(tip["translation"], float),
    )
    return BuiltInArm(
        robot=assemble([*joints, flange], tip=tip["name"], name=name),
        title=data["title"],
        rate=float(data["rate"]),
        home=tuple(float(x) for x in data["home"]),
        sources={key: str(value) for key, value in data["sources"].items()},
    )


@cache
def _data(name: str) -> dict[str, Any]:
    if name not in built_in_names():
        raise DefinitionError(f"there is no built-in arm `{name}`; {nearest_word(name, built_in_names())}")
    return YAML(typ="safe", pure=True).load((FILES / f"{name}.yaml").read_text(encoding="utf-8"))


def _joint(entry: dict[str, Any]) -> Joint:
    link = entry["link"]
    xx, yy, zz, xy, xz, yz = link["inertia"]
    lower, upper = entry.get("position", (-math.inf, math.inf))
    kind = entry["kind"]
    return Joint(
        name=entry["name"],
        kind="revolute" if kind == "continuous" else kind,
        parent=entry["parent"],
        link=link["name"],
        rotation=rotation_by_roll_pitch_yaw(entry["turn"]),
        translation=np.asarray(entry["translation"], float),
        axis=np.asarray(entry["axis"], float),
        mass=float(link["mass"]),
        center=np.asarray(link["center"], float),
        inertia=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float),
        lower=float(lower),
        upper=float(upper),
        velocity=float(entry.get("velocity", math.inf)),
        torque=float(entry.get("torque", math.inf)),
        torque_rate=float(entry.get("torque_rate", math.inf)),
        armature=float(entry.get("armature", 0.0)),
    )


def gen3() -> Articulated:
    """Return the Kinova Gen3, 7 joints, with the tip at its flange."""
    return built_in_arm("gen3").robot


def iiwa14() -> Articulated:
    """Return the KUKA LBR iiwa 14 R820, 7 joints, with the tip at its flange."""
    return built_in_arm("iiwa14").robot


def panda() -> Articulated:
    """Return the Franka Emika Panda, 7 joints, with the tip at its flange."""
    return built_in_arm("panda").robot


def ur5e() -> Articulated:
    """Return the Universal Robots UR5e, 6 joints, with the tip at its flange."""
    return built_in_arm("ur5e").robot


def xarm7() -> Articulated:
    """Return the UFactory xArm7, 7 joints, with the tip at its flange."""
    return built_in_arm("xarm7").robot
