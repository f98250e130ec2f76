"""An identified arm as a YAML file, with an uncertainty for each number."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax._writing import reason, write_text

from .identification import Estimated, Identification

DIGITS = 9
"""Of the numbers: fewer, and rounding could make a body that cannot be."""


def write_arm(identification: Identification, robot: Mapping[str, Any], path: str | Path) -> None:
    """Writes the arm with what was identified, which `robot: {kind: identified, file: ...}` reads.

    Under `robot` is its description as in scenario files, with the numbers found; under `uncertainty`, by their paths
    there, the standard error, unit and whether the log shows it; under `torque_offset` what is no part of an arm.

    - `identification`: the identified arm.
    - `robot`: the description of the arm as it was known, such as `{"kind": "panda"}`.
    - `path`: where to.

    Raises DefinitionError if the file cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, arm_as_yaml(identification, robot, path.parent))
    except OSError as error:
        raise DefinitionError(f"cannot write the file `{path}`: {reason(error)}") from None


def arm_as_yaml(identification: Identification, robot: Mapping[str, Any], folder: Path = Path()) -> str:
    """The text of such a file.

    - `identification`, `robot`: as in `write_arm`.
    - `folder`: where it will be, for the path of a file that the description names.
    """
    described = {key: value for key, value in robot.items() if key not in ("nominal", "plant")}
    if "file" in described:
        described["file"] = os.path.relpath(described["file"], folder)
    nominal = dict(robot.get("nominal", {}))
    plant: dict[str, Any] = {}
    named = {parameter.name for parameter in identification.parameters}
    if "armature" in named:
        nominal["armature"] = _plain(identification.robot.armature)
    if "payload.mass" in named:
        nominal.pop("load", None)
        load = identification.robot.payload
        if float(load.mass) > 0:
            nominal["load"] = {"mass": _plain(load.mass), "center": _plain(load.center), "inertia": _six(load.inertia)}
    if "link.mass" in named:
        arm = identification.robot
        inertias = [_six(inertia) for inertia in np.asarray(arm.inertias)]
        nominal["links"] = {"mass": _plain(arm.masses), "center": _plain(arm.centers), "inertia": inertias}
    for name in ("coulomb", "viscous"):
        if name in named:
            plant[name] = _plain(getattr(identification.robot, name))
    lines = [
        f"# {identification.robot.name}, identified from {identification.log.source}: "
        f"{len(identification.log.t)} samples.",
        "# Standard errors are of one sigma; `seen: false` means that the log does not show it.",
        *(f"# Warning: {sentence}." for sentence in identification.warnings),
        "robot:",
        *_block(described | ({"nominal": nominal} if nominal else {}) | ({"plant": plant} if plant else {}), 1),
        "uncertainty:",
        *(_line(parameter) for parameter in identification.parameters if parameter.path),
    ]
    offsets = [parameter for parameter in identification.parameters if parameter.name in ("offset", "asymmetry")]
    for name in dict.fromkeys(parameter.name for parameter in offsets):
        own = [parameter for parameter in offsets if parameter.name == name]
        lines.append(f"torque_{name}:")
        lines.append(f"  value: {_flow([parameter.value for parameter in own])}")
        lines.append(f"  standard_error: {_flow([parameter.standard_error for parameter in own])}")
    return "\n".join(lines) + "\n"


def _line(parameter: Estimated) -> str:
    is_seen = "true" if parameter.identifiable else "false"
    error = _flow(_rounded(parameter.standard_error, 4))
    return f'  robot.{parameter.path}: {{standard_error: {error}, unit: "{parameter.unit}", seen: {is_seen}}}'


def _block(mapping: Mapping[str, Any], depth: int) -> list[str]:
    lines: list[str] = []
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            lines += [f"{'  ' * depth}{key}:", *_block(value, depth + 1)]
        else:
            lines.append(f"{'  ' * depth}{key}: {_flow(value)}")
    return lines


def _flow(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_flow(entry) for entry in value)}]"
    # YAML takes 1e-05 for text without a point.
    return repr(float(value)) if "e" not in repr(float(value)) else f"{float(value):.{DIGITS}e}"


def _plain(values: Any) -> Any:
    array = np.asarray(values)
    return _rounded(array.item(), DIGITS) if array.ndim == 0 else [_plain(entry) for entry in array]


def _six(inertia: Any) -> Sequence[float]:
    full = np.asarray(inertia)
    return [_plain(full[pair]) for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")
