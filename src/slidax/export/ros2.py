"""A scenario's law as a ROS 2 package: a ros2_control controller with its parameters, and a Python node."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import slidax
from slidax.certify.motion.admission import allowed_error
from slidax.certify.motion.certified_law import CertifiedLaw
from slidax.core.errors import DefinitionError, short_repr
from slidax.core.joint_names import are_numbered
from slidax.core.writing import write_text
from slidax.scenarios.scenario import Scenario

from .admission import DOUBLES_ONLY, export_admission
from .c_project import CProject, export_c, write_files, writing
from .c_structures import Member
from .guarded_step import own_plant
from .onboard.ros2_node import Node
from .robots import RobotLimits, weight_by_robot, write_onboard

Floats = NDArray[np.float64]

KEPT = ("nominal_payload_mass", "nominal_payload_center", "nominal_gravity_vector", "nominal_armature")
"""Parameters of the nominal arm that ROS can set; the others describe the arm itself and keep their exported values."""


STOPPED = 0.05
"""Largest speed of a joint that counts as at rest, rad/s or m/s."""


RATE_TOLERANCE = 0.01
"""Largest relative difference between the update rate and the law's rate, at export and in the controller."""


@dataclass(frozen=True)
class RosParameter:
    """One parameter of the controller, as `generate_parameter_library` declares it.

    - `name`: name in ROS, such as `law.surface_k1`.
    - `type`: its type as that library names it, such as `double_array`.
    - `checks`: pairs of a validator of that library and its arguments, as text: `("gt<>", "[0.0]")`.
    - `default`: default as YAML text.
    - `meaning`: meaning with unit and range.
    - `member`: member of the law's parameters in C; None for other parameters.
    """

    name: str
    type: str
    default: str
    meaning: str
    checks: tuple[tuple[str, str], ...] = ()
    member: Member | None = None


def ros_parameters(
    project: CProject, allowed: RobotLimits, joint_names: Sequence[str], guaranteed: Floats | None = None
) -> list[RosParameter]:
    """Return all parameters of the ros2_control controller, with their defaults.

    - `project`: the exported law.
    - `allowed`: limits of the robot, the defaults of the controller's limits.
    - `joint_names`: joint names of the hardware interfaces, in the law's order.
    - `guaranteed`: largest guaranteed error bound with which a goal is accepted by default [n], rad or m; 0 accepts any
      bound. None if goals are accepted without a guarantee.
    """
    n = len(joint_names)
    rows = [
        RosParameter("joints", "string_array", as_list(map(as_text, joint_names)), "joint names, in the law's order"),
        RosParameter("state_topic", "string", '"~/state"', "topic to which signals, errors and status are published"),
        RosParameter("trajectory_topic", "string", '"~/joint_trajectory"', "topic of the received trajectories"),
        *(
            [
                RosParameter(
                    "positions_topic", "string", '"~/positions"', "topic of streamed positions, in the law's order"
                )
            ]
            if project.stream
            else []
        ),
        RosParameter("hold", "double", "1.0", "initial hold at the measured posture, s", (("gt_eq<>", "[0.0]"),)),
        RosParameter("ramp", "double", "1.0", "duration of a requested stop, s", (("gt<>", "[0.0]"),)),
        RosParameter("retime", "bool", "false", "slow down a goal that exceeds a limit, instead of rejecting it"),
        RosParameter("slowest", "double", "10.0", "largest factor to slow a goal down by", (("gt_eq<>", "[1.0]"),)),
        RosParameter("goal_time", "double", "1.0", "longest wait for a goal's tolerances, s", (("gt_eq<>", "[0.0]"),)),
    ]
    size = (("fixed_size<>", f"[{n}]"),)
    q, speed, tau = allowed.unit(), allowed.unit("/s"), allowed.torque_unit()
    for name, default, meaning in (
        ("path", np.zeros(n), f"largest errors along a goal's path, {q}; 0: only limits.error_full applies"),
        ("goal", allowed.error_hold, f"largest errors at a goal, {q}; 0: no limit"),
        ("stopped", np.full(n, STOPPED), f"largest speeds at a goal, {speed}; 0: no limit"),
    ):
        rows.append(RosParameter(f"tolerances.{name}", "double_array", as_list(map(_number, default)), meaning, size))
    for name, meaning in (
        ("lower", f"smallest positions, {q}"),
        ("upper", f"largest positions, {q}"),
        ("speed", f"largest speeds, {speed}"),
        ("torque", f"largest torques of a command, {tau}"),
        ("rate", f"fastest change of a command, {allowed.torque_unit('/s')}"),
        ("torque_hold", f"largest torques while the arm first holds its posture, {tau}"),
        ("error_hold", f"largest errors while the arm first holds its posture, {q}"),
        ("error_full", f"largest errors after the initial hold, {q}"),
        ("acceleration", f"largest accelerations of a trajectory, {allowed.unit('/s^2')}"),
    ):
        # Infinite limits become a large number that no robot reaches.
        numbers = [_number(np.clip(value, -1e9, 1e9)) for value in allowed[name]]
        rows.append(RosParameter(f"limits.{name}", "double_array", as_list(numbers), meaning, size))
    share = ("gt<>", "[0.0]"), ("lt_eq<>", "[1.0]")
    meaning = "share of the torque limits that a trajectory may use; the remainder is for the law"
    rows.append(RosParameter("limits.torque_share", "double", _number(allowed.share), meaning, share))
    for name, number, meaning in (
        ("held", allowed.held, "most consecutive periods with a held command, then the control stops"),
        ("lost", allowed.lost, "number of periods between two samples at which the control stops"),
        ("outside", allowed.outside, "most consecutive periods outside the envelope, then the arm comes to rest"),
        ("limited", allowed.limited, "most consecutive periods with a limited torque, then the arm comes to rest"),
    ):
        rows.append(RosParameter(f"limits.{name}", "int", str(number), meaning, (("gt<>", "[0]"),)))
    if guaranteed is not None:
        meaning = f"largest error bounds with which a goal is accepted, {q}; 0: any bound"
        rows += [
            RosParameter("guarantee.required", "bool", "true", "accept only goals inside the guarantee of the law"),
            RosParameter("guarantee.error", "double_array", as_list(map(_number, guaranteed)), meaning, size),
            RosParameter("guarantee.assume_steps", "bool", "false", "admit without a proof of the torque's rate limit"),
        ]
    return rows + [_of_the_law(member) for member in project.parameters if _settable(member)]


def yaml(namespace: str, rows: Sequence[RosParameter]) -> str:
    """Return the text of the YAML file from which `generate_parameter_library` generates C++ code.

    - `namespace`: namespace of the generated code.
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


def _of_the_law(member: Member) -> RosParameter:
    assert member.values is not None
    numbers = [_number(value) for value in member.values.ravel().tolist()]
    checks = _checks(member.meaning, vector=bool(member.shape))
    if member.shape:
        checks = (("fixed_size<>", f"[{member.size}]"), *checks)
    default = as_list(numbers) if member.shape else numbers[0]
    kind = "double_array" if member.shape else "double"
    return RosParameter(f"law.{member.name}", kind, default, member.meaning or member.name, checks, member)


def _checks(meaning: str, *, vector: bool) -> tuple[tuple[str, str], ...]:
    """Return the validators for the range at the end of a parameter's meaning; none if a bound is not a number."""
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
    """Return a YAML list of texts."""
    return f"[{', '.join(texts)}]"


def as_text(text: str) -> str:
    """Return a one-line text as a quoted YAML string; double quotation marks become single ones."""
    return '"' + text.replace("\\", "\\\\").replace('"', "'") + '"'


FILES = {
    "ros2/controller.hpp.j2": "include/slidax_{name}_controller/controller.hpp",
    "ros2/controller.cpp.j2": "src/controller.cpp",
    "ros2/plugin.xml.j2": "slidax_{name}_controller.xml",
    "ros2/package.xml.j2": "package.xml",
    "ros2/CMakeLists.txt.j2": "CMakeLists.txt",
    "ros2/controllers.yaml.j2": "config/controllers.yaml",
    "ros2/control.launch.py.j2": "launch/control.launch.py",
    "ros2/README.md.j2": "README.md",
}
"""Output file of each template."""


def export_ros2(
    scenario: Scenario,
    out: Path,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    gravity: str = "law",
    golden: bool = True,
    admission: bool = False,
) -> CProject:
    """Write a ROS 2 package to `out`: a controller for ros2_control, a Python node, and the law that both run.

    Trajectories arrive by the action `FollowJointTrajectory` or a topic; the scenario's motion is not used.

    - `name`, `single`, `command`: as in `export_c`.
    - `gravity`: "law" if the law compensates gravity, "robot" if the robot adds its gravity torque to each effort.
    - `golden`: include the tests and golden samples, which take most of the time.
    - `admission`: accept only goals inside the guarantee of the law (`slidax admit`).

    Raises DefinitionError if the scenario cannot be exported. With `admission`, also if no error bound covers its law.
    """
    if gravity not in ("law", "robot"):
        raise DefinitionError(f'`gravity` must be "law" or "robot"; got "{gravity}"')
    carried = gravity == "robot"
    if admission and carried:
        raise DefinitionError(
            'the guarantee covers only a law that compensates gravity itself: set `gravity` to "law" (--gravity law)'
        )
    if admission and single:
        raise DefinitionError(DOUBLES_ONLY)
    rate = update_rate(scenario.period)
    names = interface_names(own_plant(scenario).robot.joint_names)
    fitted = weight_by_robot(scenario) if carried else scenario
    # Before anything is written, since it may be refused.
    certified = CertifiedLaw.of(fitted) if admission else None
    exported = export_c(fitted, out / "law", name=name, single=single, command=command, golden=golden)
    allowed = RobotLimits.of(fitted, exported, carried=carried)
    package = f"slidax_{exported.name}_controller"
    guaranteed = None
    if admission:
        export_admission(fitted, exported, out / "law", trajectories=True, certified=certified)
        tolerance = allowed_error(fitted)
        guaranteed = np.zeros(len(names)) if tolerance is None else np.broadcast_to(tolerance, len(names))
    rows = ros_parameters(exported, allowed, names, guaranteed)
    values: dict[str, Any] = {
        "o": allowed,
        "package": package,
        "rows": rows,
        "law_rows": [row for row in rows if row.member is not None],
        "joints": as_list(map(as_text, names)),
        "rate": rate,
        "rate_tolerance": RATE_TOLERANCE,
        "carried": carried,
        "admission": admission,
        "version": slidax.__version__,
        # Signals of the law to publish, with their sizes.
        "signals": [(each.name, each.size) for each in exported.outputs if each.type == "f64"],
    }
    write_onboard(exported, allowed, out, {"node.py": Node}, names)
    write_files(exported, out, FILES, **values)
    with writing(out):
        write_text(out / "src" / "parameters.yaml", yaml(package, rows))
    return exported


def update_rate(period: float) -> int:
    """Return the update rate of a controller for a sample time [s], in Hz: ros2_control takes whole numbers only.

    Raises DefinitionError if no whole rate is near enough, by the rule that the exported controller checks.
    """
    rate = round(1.0 / period)
    if not abs(rate * period - 1.0) < RATE_TOLERANCE:
        raise DefinitionError(
            f"ros2_control updates at a whole number of hertz, and a period of {period:g} s is {1.0 / period:.4g} Hz: "
            "set `simulation.period` to 1/N s with a whole N, such as "
            f"`--set simulation.period={1.0 / max(rate, 1):.8g}`"
        )
    return rate


def interface_names(joints: Sequence[str]) -> list[str]:
    """Return the joint names for the hardware interfaces: unchanged, but slidax's default `joint 1` becomes `joint_1`.

    Raises DefinitionError for a name that a ROS 2 parameter file cannot hold.
    """
    if are_numbered(joints):
        return [name.replace(" ", "_") for name in joints]
    for name in joints:
        if not name.isprintable() or '"' in name or "\\" in name:
            raise DefinitionError(
                f"joint {short_repr(name)}: a name with a quotation mark, a backslash or a control character cannot be "
                "used in a ROS 2 parameter file: rename the joint in the robot's and the hardware's files"
            )
    return list(joints)
