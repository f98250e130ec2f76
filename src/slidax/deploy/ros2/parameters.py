"""The law's parameters as ROS 2 parameters: name, default, range and meaning."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..contents import Project
from ..members import Member
from ..onboard import Allowed

KEPT = ("nominal_payload_mass", "nominal_payload_center", "nominal_gravity_vector", "nominal_armature")
"""Settable parameters of the nominal arm; the others describe the arm itself and keep their compiled values."""


@dataclass(frozen=True)
class Declared:
    """One parameter.

    - `name`: such as `law.surface_k1`.
    - `type`, `checks`: of the parameter library, each check with its arguments.
    - `default`: as written in YAML.
    - `meaning`: with unit and range.
    - `member`: of the law's parameters; None for other parameters.
    """

    name: str
    type: str
    default: str
    meaning: str
    checks: tuple[tuple[str, str], ...] = ()
    member: Member | None = None


def declared(project: Project, allowed: Allowed, joint_names: Sequence[str]) -> list[Declared]:
    """All parameters of the controller."""
    n = len(joint_names)
    rows = [
        Declared("joints", "string_array", as_list(map(as_text, joint_names)), "names, in the law's order"),
        Declared("state_topic", "string", '"~/state"', "where signals, errors and status are published"),
        Declared("trajectory_topic", "string", '"~/joint_trajectory"', "where trajectories come from"),
        Declared("hold", "double", "1.0", "initial hold of the measured posture, s", (("gt_eq<>", "[0.0]"),)),
        Declared("ramp", "double", "1.0", "duration of a requested stop, s", (("gt<>", "[0.0]"),)),
    ]
    units = {"lower": allowed.unit, "upper": allowed.unit, "speed": f"{allowed.unit}/s", "torque": allowed.torque_unit}
    units |= {"rate": f"{allowed.torque_unit}/s", "torque_hold": allowed.torque_unit}
    words = {
        "lower": "least positions",
        "upper": "largest positions",
        "speed": "largest speeds",
        "torque": "largest torques of a command",
        "rate": "fastest change of a command",
        "torque_hold": "largest torques while it holds",
        "error_hold": "largest errors while it holds",
        "error_full": "largest errors later",
    }
    for name, meaning in words.items():
        # Infinite limits become a large number that no robot reaches.
        numbers = [_number(np.clip(value, -1e9, 1e9)) for value in allowed[name]]
        checks = (("fixed_size<>", f"[{n}]"),)
        unit = units.get(name, allowed.unit)
        rows.append(Declared(f"limits.{name}", "double_array", as_list(numbers), f"{meaning}, {unit}", checks))
    for name, number, meaning in (
        ("held", allowed.held, "periods in a row without a good sample, then it stops"),
        ("lost", allowed.lost, "periods between two samples, then it stops"),
        ("outside", allowed.outside, "periods in a row outside the law's envelope, then it comes to rest"),
        ("limited", allowed.limited, "periods in a row with a limited torque, then it comes to rest"),
    ):
        rows.append(Declared(f"limits.{name}", "int", str(number), meaning, (("gt<>", "[0]"),)))
    return rows + [_of_the_law(member) for member in project.parameters if _settable(member)]


def yaml(namespace: str, rows: Sequence[Declared]) -> str:
    """The file of the parameter library.

    - `namespace`: of the C++ code that it makes.
    - `rows`: the parameters.
    """
    lines = [f"{namespace}:"]
    last: list[str] = []
    for row in rows:
        *parents, name = row.name.split(".")
        if parents != last:
            lines += [f"{'  ' * (1 + k)}{parent}:" for k, parent in enumerate(parents)]
            last = parents
        indent = "  " * (1 + len(parents))
        lines.append(f"{indent}{name}:")
        lines.append(f"{indent}  type: {row.type}")
        lines.append(f"{indent}  default_value: {row.default}")
        lines.append(f"{indent}  description: {as_text(row.meaning)}")
        lines.append(f"{indent}  read_only: false")
        if row.checks:
            lines.append(f"{indent}  validation:")
            lines += [f"{indent}    {check}: {arguments}" for check, arguments in row.checks]
    return "\n".join([*lines, ""])


def _settable(member: Member) -> bool:
    assert member.values is not None
    own = not member.name.startswith("nominal_") or member.name in KEPT
    # The period is the update rate, set elsewhere.
    return own and member.type == "f64" and member.name != "period" and bool(np.isfinite(member.values).all())


def _of_the_law(member: Member) -> Declared:
    assert member.values is not None
    numbers = [_number(value) for value in member.values.ravel().tolist()]
    checks = _checks(member.meaning, vector=bool(member.shape))
    if member.shape:
        checks = (("fixed_size<>", f"[{member.size}]"), *checks)
    default = as_list(numbers) if member.shape else numbers[0]
    kind = "double_array" if member.shape else "double"
    return Declared(f"law.{member.name}", kind, default, member.meaning or member.name, checks, member)


def _checks(meaning: str, *, vector: bool) -> tuple[tuple[str, str], ...]:
    """The range at the end of a meaning, if its bounds are numbers."""
    low = re.search(r", (>=?) (-?[\d.e-]+)(?:, infinite for no limit)?$", meaning)
    if low is not None:
        sign, bound = low.groups()
        if vector:
            return (("lower_element_bounds<>", f"[{_number(float(bound))}]"),)
        return ((("gt_eq<>" if sign == ">=" else "gt<>"), f"[{_number(float(bound))}]"),)
    both = re.search(r", in [\[(](-?[\d.e-]+), (-?[\d.e-]+)[\])]$", meaning)
    if both is not None:
        bounds = f"[{_number(float(both[1]))}, {_number(float(both[2]))}]"
        return (("element_bounds<>" if vector else "bounds<>", bounds),)
    return ()


def _number(value: Any) -> str:
    text = repr(float(value))
    # YAML reads 1e-05 as a string: it needs a decimal point.
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


def as_list(texts: Iterable[str]) -> str:
    """A list in YAML."""
    return f"[{', '.join(texts)}]"


def as_text(text: str) -> str:
    """A one-line text in YAML; double quotation marks become single ones."""
    return '"' + text.replace("\\", "\\\\").replace('"', "'") + '"'
