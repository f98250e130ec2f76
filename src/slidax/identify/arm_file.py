"""YAML file of an identified arm, with the confidence region of the true arm."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax.arms.articulated import PAIRS
from slidax.core.errors import DefinitionError
from slidax.core.writing import error_reason, write_text

from .band import Band
from .identified_arm import EstimatedParameter, Identification

NOT_OF_ARM = ("offset", "asymmetry", "stribeck", "ripple")
"""First words of the drive parameters that have no key in an arm's description."""

DIGITS = 9
"""Significant digits in the file: with fewer, rounding could make a body physically inconsistent."""


def write_arm(identification: Identification, robot: Mapping[str, Any], path: str | Path) -> None:
    """Write the identified arm to a file that `robot: {kind: identified, file: ...}` reads.

    The section `robot` is the arm's description as in scenario files, with the identified parameters. The section
    `uncertainty` is the confidence region of the true arm (`Identification.band`). For an arm without a band it lists
    the standard error of each parameter. The sections `torque_offset`, `torque_asymmetry`, `torque_stribeck`,
    `torque_ripple_N_cos` and `torque_ripple_N_sin` (N periods per turn, such as `torque_ripple_30_cos`) are identified
    torque terms for which an arm's description has no key. The sections `actuator` and `actuator_map` have the
    identified map from the log's torques to the joints' torques, and its standard errors.

    - `identification`: the identified arm.
    - `robot`: the arm's description before identification, such as `{"kind": "panda"}`.
    - `path`: the file to write.

    Raises DefinitionError if the file cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, arm_as_yaml(identification, robot, path.parent))
    except OSError as error:
        raise DefinitionError(f"cannot write the file `{path}`: {error_reason(error)}") from None


def arm_as_yaml(identification: Identification, robot: Mapping[str, Any], folder: str | Path = Path()) -> str:
    """Return the text of the file that `write_arm` writes.

    - `identification`, `robot`: as in `write_arm`.
    - `folder`: the file's folder; paths in the description become relative to it.
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
    if "encoder_offset" in named:
        nominal["zero"] = _plain(identification.values("encoder_offset") + np.asarray(nominal.get("zero", 0.0)))
    if "gravity.x" in named:
        nominal["gravity"] = _plain(identification.robot.gravity_vector)
    if "link.mass" in named:
        arm = identification.robot
        inertias = [_six(inertia) for inertia in np.asarray(arm.inertias)]
        nominal["links"] = {"mass": _plain(arm.masses), "center": _plain(arm.centers), "inertia": inertias}
    for name, section in (("coulomb", plant), ("viscous", nominal)):
        if name in named:
            section[name] = _plain(getattr(identification.robot, name))
    lines = [
        *(
            f"# {identification.robot.name}, identified from {fit.log.source}: {len(fit.log.t)} samples."
            for fit in identification.logs
        ),
        *(f"# Warning: {sentence}." for sentence in identification.warnings),
        "robot:",
        *_block(described | ({"nominal": nominal} if nominal else {}) | ({"plant": plant} if plant else {}), 1),
        "uncertainty:",
        *(_standard_errors(identification) if identification.band is None else _band_lines(identification.band)),
    ]
    offsets = [each for each in identification.parameters if each.name.partition("_")[0] in NOT_OF_ARM]
    for name in dict.fromkeys(parameter.name for parameter in offsets):
        own = [parameter for parameter in offsets if parameter.name == name]
        lines.append(f"torque_{name}:")
        lines.append(f"  value: {_flow([parameter.value for parameter in own])}")
        lines.append(f"  standard_error: {_flow([parameter.standard_error for parameter in own])}")
    if identification.actuator_map is not None:
        values, errors = identification.actuator_map
        lines += ["actuator:", "  map:", *(f"    - {_short(row)}" for row in values)]
        lines += ["actuator_map:", "  standard_error:", *(f"    - {_short(row)}" for row in errors)]
    return "\n".join(lines) + "\n"


def _band_lines(band: Band) -> list[str]:
    """Return the YAML lines of a band: the set of the inertial parameters, and the intervals of friction."""
    lines = [
        f"  # {band}",
        "  robot.plant.inertial:",
        f"    band: {_flow(_rounded(band.p, 4))}",
        f"    confidence: {_flow(band.confidence)}",
        "    deviations:",
        *(f"    - {_short(row)}" for row in band.deviations),
    ]
    for name in ("coulomb", "viscous"):
        ends = getattr(band, name)
        if ends.size:
            rows = ", ".join(_short(row) for row in ends)
            lines.append(f"  robot.plant.{name}: {{between: [{rows}], each: joint}}")
    return lines


def _standard_errors(identification: Identification) -> list[str]:
    return [
        "  # Standard errors are one sigma; `identifiable: false`: the log determines the parameter poorly or not at "
        "all.",
        *(_line(parameter) for parameter in identification.parameters if parameter.path),
    ]


def _short(row: np.ndarray) -> str:
    # YAML reads `1e-05`, without a decimal point, as text.
    return f"[{', '.join(f'{value:.5e}' if value else '0' for value in row)}]"


def _line(parameter: EstimatedParameter) -> str:
    known = "true" if parameter.identifiable else "false"
    error = _flow(_rounded(parameter.standard_error, 4))
    return f'  robot.{parameter.path}: {{standard_error: {error}, unit: "{parameter.unit}", identifiable: {known}}}'


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
    # YAML reads `1e-05`, without a decimal point, as text.
    return repr(float(value)) if "e" not in repr(float(value)) else f"{float(value):.{DIGITS}e}"


def _plain(values: Any) -> Any:
    array = np.asarray(values)
    return _rounded(array.item(), DIGITS) if array.ndim == 0 else [_plain(entry) for entry in array]


def _six(inertia: Any) -> Sequence[float]:
    full = np.asarray(inertia)
    return [_plain(full[pair]) for pair in PAIRS]


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}")
