"""From a description file of ours to an arm."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from slidax._errors import DefinitionError, nearest

from ..articulated import Articulated
from ..assemble import assemble
from ..joint import Joint

FILES = resources.files("slidax.robots") / "ready"

NAMES = ("panda", "ur5e", "iiwa14", "xarm7", "gen3")
"""The arms there are."""


@dataclass(frozen=True)
class Ready:
    """An arm, and what its maker says of it.

    - `robot`: the arm, without friction.
    - `title`: its full name.
    - `rate`: samples per second at which its interface takes commands, 1/s.
    - `home`: a usual posture [n], rad.
    - `sources`: where each group of numbers comes from.
    """

    robot: Articulated
    title: str
    rate: float
    home: tuple[float, ...]
    sources: dict[str, str]


def title(name: str) -> str:
    """What an arm is called, without reading all of its file.

    - `name`: one of `NAMES`.
    """
    found = re.search(r"^title: (.+)$", (FILES / f"{name}.yaml").read_text(encoding="utf-8"), re.MULTILINE)
    return found.group(1) if found else name


def read(name: str) -> Ready:
    """An arm by its name.

    - `name`: one of `NAMES`.

    Raises DefinitionError if there is none of that name.
    """
    if name not in NAMES:
        raise DefinitionError(f"there is no ready robot `{name}`; {nearest(name, NAMES)}")
    data = YAML(typ="safe", pure=True).load((FILES / f"{name}.yaml").read_text(encoding="utf-8"))
    tip = data["tip"]
    joints = [_joint(entry) for entry in data["joints"]]
    flange = Joint(
        name=f"{tip['name']}_joint",
        kind="fixed",
        parent=tip["joint"],
        link=tip["name"],
        rotation=_turned(tip["turn"]),
        translation=np.asarray(tip["translation"], float),
    )
    return Ready(
        robot=assemble([*joints, flange], tip=tip["name"], name=name),
        title=data["title"],
        rate=float(data["rate"]),
        home=tuple(float(x) for x in data["home"]),
        sources={key: str(value) for key, value in data["sources"].items()},
    )


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
        rotation=_turned(entry["turn"]),
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


def _turned(turn: Any) -> np.ndarray:
    """The axes of a frame that is turned about x, y and z of the frame before it, in this order."""
    roll, pitch, yaw = (float(angle) for angle in turn)
    cr, sr, cp, sp, cy, sy = (f(angle) for angle in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
