"""The law's parameters as those of a ROS 2 controller: name, default, range and what they mean."""

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
"""Of the nominal arm's numbers; the others are the arm itself, and stay as they are compiled."""


@dataclass(frozen=True)
class Declared:
    """One parameter.

    - `name`: with the part it belongs to, such as `law.surface_k1`.
    - `type`: as the parameter library calls it.
    - `default`: as YAML writes it.
    - `meaning`: what it is, with unit and range.
    - `checks`: of the parameter library, each with its arguments.
    - `member`: of the law's parameters; None for another one.
    """

    name: str
    type: str
    default: str
    meaning: str
    checks: tuple[tuple[str, str], ...] = ()
    member: Member | None = None


def declared(project: Project, allowed: Allowed, joint_names: Sequence[str]) -> list[Declared]:
    """All of a controller's parameters.

    - `project`: the law.
    - `allowed`: what the robot allows.
    - `joint_names`: as the robot has them.
    """
    n = len(joint_names)
    rows = [
        Declared("joints", "string_array", as_list(map(as_text, joint_names)), "names, in the law's order"),
        Declared("state_topic", "string", '"~/state"', "where signals, errors and status are published"),
        Declared("trajectory_topic", "string", '"~/joint_trajectory"', "where trajectories come from"),
        Declared("hold", "double", "1.0", "how long the measured posture is held at first, s", (("gt_eq<>", "[0.0]"),)),
        Declared("ramp", "double", "1.0", "in which it comes to rest when that is asked for, s", (("gt<>", "[0.0]"),)),
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
        # What has no limit has none in the parameters either: a large number that no robot reaches.
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
    # The period is the update rate, which is not set here.
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
    """The range at the end of a meaning, as far as its bounds are numbers."""
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
    # YAML takes 1e-05 for a string: it wants a point.
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


def as_list(texts: Iterable[str]) -> str:
    """A list in YAML.

    - `texts`: its entries as YAML has them.
    """
    return f"[{', '.join(texts)}]"


def as_text(text: str) -> str:
    """A text in YAML; quotation marks become single ones.

    - `text`: in one line.
    """
    return '"' + text.replace("\\", "\\\\").replace('"', "'") + '"'
