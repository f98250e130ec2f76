"""Exports for robots: the law, the robot's limits and the programs that run the law on Franka and UR arms.

The exported pilot is C code between the robot's interface and the law. It generates the reference, checks the
measurements and the law's status, and brings the arm to rest or ends the control.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.codegen.c.expressions import Dialect, Helpers
from slidax.core.errors import DefinitionError
from slidax.core.writing import write_text
from slidax.plant.actuators import Actuator, TorqueLimits
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from .c_project import CProject, describe_law, export_c, units_text, write_files, writing
from .c_source import function_body
from .c_structures import Member
from .guarded_step import own_plant
from .onboard.franka import run_franka
from .onboard.pilot import MotionLog, Pilot, load_law
from .onboard.rehearsal import rehearse
from .onboard.ur import run_ur
from .programs import torque_program


@dataclass(frozen=True)
class Reason:
    """Reason for the end of a motion.

    - `name`: its name in C, without the prefix.
    - `meaning`: the reason in words.
    - `stops`: True if the control ends at once; False if the arm first comes to rest along its path.
    - `remedy`: advice to the user.
    """

    name: str
    meaning: str
    stops: bool
    remedy: str


REASONS = (
    Reason("NONE", "nothing is wrong", False, "The motion is over."),
    Reason("REQUESTED", "a stop was requested", False, "Nothing is wrong."),
    Reason(
        "NOT_BEGUN",
        "the motion has not begun: an option is invalid",
        True,
        "Check the options of the path.",
    ),
    Reason("NO_MEASUREMENT", "no good measurement for too long", True, "Check the sensor and the link to it."),
    Reason("NO_REFERENCE", "no finite reference for too long", True, "Check the planner."),
    Reason("NO_TORQUE", "no finite torque from the law for too long", True, "Check the gains for an absurd value."),
    Reason("LOST", "too many periods without a sample", True, "Check the network and the other load of the computer."),
    Reason(
        "ERROR_HOLDING",
        "the error is too large while the arm should hold its posture",
        True,
        "Check the order and the signs of the joints, the gravity compensation, and external forces.",
    ),
    Reason(
        "TORQUE_HOLDING",
        "holding the posture takes too much torque although the robot compensates gravity",
        True,
        "Gravity is compensated twice, or the robot's settings lack a payload.",
    ),
    Reason(
        "ERROR_MOVING",
        "the error is too large",
        True,
        "Check for a collision, a wrong model, or limits too tight for the motion.",
    ),
    Reason(
        "REFERENCE_OUTSIDE",
        "the reference leaves the joints' range or speed",
        True,
        "Make the motion smaller or slower.",
    ),
    Reason("POSITION_LIMIT", "a joint is beyond its range", True, "Move it back by hand, and check the motion."),
    Reason("SPEED_LIMIT", "a joint exceeds its speed limit", True, "Check the log for the cause, such as a push."),
    Reason(
        "OUTSIDE",
        "the law has been outside its envelope for too long",
        False,
        "Check the log, run `slidax explain` on a similar run, or widen the envelope by `scheme.performance.final`.",
    ),
    Reason(
        "LIMITED",
        "the torque has been at its limits for too long",
        False,
        "The motion needs more torque than the drives have: slow it down, or set the payload in the robot's settings.",
    ),
    Reason("VOID", "the law's guarantee has been void for too long", False, "See `assumption_violated` for the cause."),
    Reason("POSTURE_NOT_FINITE", "the measured posture is not finite", True, "Check the sensor and the link to it."),
)
"""All reasons; the index of a reason is its number in C."""


LEAST = 0.1
"""Smallest share of a joint's torque limit that the law gets, however large the gravity torque is."""

RATE_SHARE = 0.99
"""Share of the torque rate limit that the law uses, so that rounding does not violate the limit."""

LOOKS = 200
"""Number of times along the motion at which the gravity torque is evaluated."""


def weight_by_robot(scenario: Scenario) -> Scenario:
    """Return a scenario adapted to a robot that compensates gravity itself: no gravity acts in its law and arm.

    The law's nominal arm has gravity 0, so that the command contains no gravity torque. Errors of the robot's gravity
    compensation act as a disturbance. Each joint's torque limit is reduced by the largest gravity torque along the
    motion.

    Raises DefinitionError if the arm is not `Articulated`, or if the drives map commands to torques.
    """
    plant = own_plant(scenario)
    arms = [each for each in jax.tree.leaves(scenario.controller, is_leaf=_is_arm) if _is_arm(each)]
    if not isinstance(plant.robot, Articulated):
        raise DefinitionError(
            f"a robot that compensates its own gravity must be an articulated arm, as from `slidax.arms.panda()`; "
            f"`{scenario.name}` has a {type(plant.robot).__name__}"
        )
    if plant.actuator is not None and plant.actuator.map is not None:
        raise DefinitionError(
            "a robot that compensates its own gravity adds its torques after the drives' map: leave out `actuator.map`"
        )
    limits = _limits(plant)
    weight = np.abs(_weights(scenario, arms[0] if arms else plant.robot)).max(axis=0)
    torque = np.maximum(np.asarray(limits.torque) - weight, LEAST * np.asarray(limits.torque))
    eased = TorqueLimits(torque=jnp.asarray(torque), rate=jnp.asarray(np.asarray(limits.rate) * RATE_SHARE))
    actuator = Actuator(eased) if plant.actuator is None else eqx.tree_at(lambda a: a.limits, plant.actuator, eased)
    weightless: Plant = eqx.tree_at(
        lambda p: p.actuator, _weightless(plant), actuator, is_leaf=lambda leaf: leaf is None
    )
    return scenario.replace(plant=weightless, controller=_weightless(scenario.controller))


def _is_arm(node: Any) -> bool:
    return isinstance(node, Articulated)


def _weightless(tree: Any) -> Any:
    def without(node: Any) -> Any:
        if not _is_arm(node):
            return node
        return eqx.tree_at(lambda arm: arm.gravity_vector, node, jnp.zeros_like(node.gravity_vector))

    return jax.tree.map(without, tree, is_leaf=_is_arm)


def _limits(plant: Plant) -> TorqueLimits:
    """Return the torque limits of the scenario's drives, or those of the arm's data sheet where these are lower."""
    own = TorqueLimits() if plant.actuator is None else plant.actuator.limits
    assert isinstance(plant.robot, Articulated)
    sheet = plant.robot.limits
    return TorqueLimits(torque=jnp.minimum(own.torque, sheet.torque), rate=jnp.minimum(own.rate, sheet.torque_rate))


def _weights(scenario: Scenario, arm: Articulated) -> np.ndarray:
    """Return the gravity torques at times along the motion and at the initial posture, [times n], N m or N."""
    moments = jnp.linspace(0.0, scenario.t1, LOOKS)
    postures = jax.vmap(lambda t: scenario.trajectory.reference(t).q)(moments)
    return np.asarray(jax.vmap(arm.gravity)(jnp.concatenate([postures, scenario.state0.q[None]])))


MARGIN = {"rad": 0.03, "m": 0.005}
"""Distance that a joint must keep from the ends of its range, by unit."""

ERRORS = {"rad": (0.02, 0.05, 0.1), "m": (0.005, 0.01, 0.02)}
"""Largest errors while the arm holds its posture, while the motion is small, and later, by unit."""

HOLDING = 0.1
"""Largest torque of the law to hold a posture while the robot compensates gravity, relative to the torque limit."""

SPEED = 0.95
"""Share of a joint's speed limit that a motion may use."""

SHARE = 0.9
"""Share of a joint's torque limit that an external trajectory may use; the remainder is for the law's feedback."""


@dataclass(frozen=True)
class RobotLimits:
    """Limits of a robot and of its motions: data for the templates in addition to the exported law.

    - `units`, `torque_units`: units of position and torque, per joint.
    - `lower`, `upper`, `speed`, `torque`, `rate`: limits of position, speed, torque and torque rate, per joint.
    - `torque_hold`: largest torques while the arm holds its posture, per joint; infinite unless the robot compensates
      gravity.
    - `error_hold`, `error_small`, `error_full`: largest tracking errors, per joint: while the arm first holds its
      posture; in the approach and while the motion has a small amplitude; at full amplitude.
    - `acceleration`: largest accelerations of an external trajectory, per joint.
    - `share`: share of the torque limit that an external trajectory may use.
    - `dialect`: number type of the C code.
    - `held`: most consecutive periods in which the step repeats its last command, because the sample or the law's
      result is bad; after more the control ends at once.
    - `lost`: number of periods between two samples at which the control ends at once.
    - `outside`, `limited`, `void`: most consecutive periods outside the envelope, with a limited torque, and with a
      violated assumption of the guarantee; after more the arm comes to rest.
    - `age`: age of a measurement when it arrives [s].
    - `carried`: True if the robot compensates gravity.
    - `torque_lines`, `torque_helpers`, `torque_tables`: body, helper functions and constant arrays of the C function
      for the nominal arm's inverse dynamics.
    """

    units: tuple[str, ...]
    torque_units: tuple[str, ...]
    lower: list[float]
    upper: list[float]
    speed: list[float]
    torque: list[float]
    rate: list[float]
    torque_hold: list[float]
    error_hold: list[float]
    error_small: list[float]
    error_full: list[float]
    acceleration: list[float]
    share: float
    dialect: Dialect
    held: int
    lost: int
    outside: int
    limited: int
    void: int
    age: float
    carried: bool
    torque_lines: list[str]
    torque_helpers: list[str]
    torque_tables: list[Member]

    reasons = REASONS

    @classmethod
    def of(cls, scenario: Scenario, project: CProject, *, lost: int = 20, carried: bool = False) -> RobotLimits:
        """Return the limits for a scenario, from the arm's data sheet and the drives' limits.

        - `lost`: number of periods between two samples at which the control ends.
        - `carried`: True if the robot compensates gravity.
        """
        plant = own_plant(scenario)
        n = len(project.joints)
        endless = np.full(n, np.inf)
        units = plant.robot.joint_units
        margin = np.array([MARGIN[unit] for unit in units])
        errors = np.array([ERRORS[unit] for unit in units]).T.tolist()
        lower, upper, speed, hold = -endless, endless, endless, endless
        if isinstance(plant.robot, Articulated | Coupled):
            sheet = plant.robot.limits
            lower, upper = np.asarray(sheet.lower) + margin, np.asarray(sheet.upper) - margin
            speed = SPEED * np.asarray(sheet.velocity)
            hold = HOLDING * np.asarray(sheet.torque) if carried else endless
        torque, rate = endless, endless
        if plant.actuator is not None:
            torque = np.broadcast_to(np.asarray(plant.actuator.limits.torque), (n,))
            rate = np.broadcast_to(np.asarray(plant.actuator.limits.rate), (n,))
        helpers = Helpers(project.dialect)
        needed = torque_program(project.guard, project.step, plant.robot)
        body = function_body(needed, project.dialect, ("parameters", "q", "dq", "ddq", "tau"), helpers)
        return cls(
            units=tuple(units),
            torque_units=tuple(plant.robot.torque_units),
            lower=_numbers(lower),
            upper=_numbers(upper),
            speed=_numbers(speed),
            torque=_numbers(torque),
            rate=_numbers(rate),
            torque_hold=_numbers(hold),
            error_hold=errors[0],
            error_small=errors[1],
            error_full=errors[2],
            acceleration=_numbers(endless),
            share=SHARE,
            dialect=project.dialect,
            held=5,
            lost=lost,
            outside=_periods(0.1, project.period),
            limited=_periods(0.25, project.period),
            void=_periods(0.1, project.period),
            age=float(scenario.description.sensor.delay) * project.period,
            carried=carried,
            torque_lines=body.lines,
            torque_helpers=helpers.lines,
            torque_tables=needed.tables,
        )

    def unit(self, after: str = "") -> str:
        """Return the joints' units of position with a text after each, such as "/s"; a single unit if all are equal."""
        return units_text([unit + after for unit in self.units])

    def torque_unit(self, after: str = "") -> str:
        """Return the joints' units of torque, as `unit` does."""
        return units_text([unit + after for unit in self.torque_units])

    def literal(self, number: float) -> str:
        """Return a number as C source text."""
        return self.dialect.number(number, "f64")

    def shown(self, numbers: Sequence[float]) -> str:
        """Return numbers per joint as text for a C comment: a single number if all are equal, "none" for infinity."""
        texts = ["none" if np.isinf(number) else f"{number:g}" for number in numbers]
        return texts[0] if len(set(texts)) == 1 else ", ".join(texts)

    def __getitem__(self, name: str) -> list[float]:
        return getattr(self, name)


def _numbers(values: np.ndarray) -> list[float]:
    # Six digits are enough for a limit, and easier to read.
    return [float(f"{value:.6g}") for value in np.asarray(values, float).tolist()]


def _periods(seconds: float, period: float) -> int:
    return max(round(seconds / period), 1)


SOURCES = ("path", "follow", "pilot", "admit", "words")
"""C sources of the pilot, without the law's prefix and the file extension."""

C_FILES = (*(f"{name}.c" for name in SOURCES), "path.h", "follow.h", "pilot.h", "admit.h")
"""C sources and headers of the pilot, without the law's prefix."""


@dataclass(frozen=True)
class RobotTarget:
    """A robot that takes torques from an exported law, and compensates gravity itself.

    - `name`: name in messages, with its article.
    - `joints`, `period`: number of joints, and sample time [s].
    - `lost`: number of periods between two samples at which the control ends.
    - `folder`: folder of the templates.
    - `files`: output file of each template.
    - `program`: a function of the robot's Python program; its module is copied as `program.py`.
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
) -> CProject:
    """Write the programs for a robot, and the exported law that they run, to the folder `out`.

    - `target`: the robot.
    - `name`, `single`, `command`: as in `export_c`.
    - `golden`: include the tests and golden samples, which take most of the time.

    Raises DefinitionError if the scenario's number of joints or sample time differs from the robot's, or if the
    scenario cannot be exported.
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
    exported = export_c(weightless, out / "law", name=name, single=single, command=command, golden=golden)
    limits = RobotLimits.of(weightless, exported, lost=target.lost, carried=True)
    write_onboard(exported, limits, out, {"program.py": target.program})
    write_files(exported, out, {f"{target.folder}/{name}": file for name, file in target.files.items()}, o=limits)
    return exported


def write_onboard(
    exported: CProject,
    limits: RobotLimits,
    out: Path,
    programs: Mapping[str, Callable[..., Any]] | None = None,
    names: Sequence[str] = (),
    sources: Sequence[str] = (),
    more: Mapping[str, Any] | None = None,
) -> None:
    """Write the pilot to `out`: reference path and checks in C, and their Python binding.

    The exported step must already be in the folder `law` of `out`.

    - `programs`: further Python files, by file name. Each value is a function or class; its module is copied.
    - `names`: joint names, for programs that address joints by name.
    - `sources`: further C modules (source and header), by file name without the law's prefix and the extension.
    - `more`: additional values for `law.json`.

    Raises DefinitionError if the folder cannot be written.
    """
    folder = out / "law"
    c_files = (*C_FILES, *(f"{name}.{ending}" for name in sources for ending in ("c", "h")))
    write_files(exported, folder, {f"onboard/{name}.j2": f"{{prefix}}_{name}" for name in c_files}, o=limits)
    law = describe_law(exported) | dict(more or {}) | ({"names": list(names)} if names else {})
    streamed = ("stream",) if exported.stream else ()
    law["sources"] = ["", "_scenario", *(f"_{name}" for name in (*SOURCES, *streamed, *sources))]
    law["reasons"] = [{"name": each.name, "meaning": each.meaning, "stops": each.stops} for each in limits.reasons]
    law["phases"] = ["hold", "approach", "small", "widen", "motion", "rest", "follow"]
    files: dict[str, Any] = {f"{_stem(part)}.py": part for part in (Pilot, MotionLog, load_law, rehearse)}
    with writing(out):
        write_text(folder / "law.json", json.dumps(law, indent=1) + "\n")
        for file, part in {**files, **(programs or {})}.items():
            write_text(out / file, standalone_source(part))


def standalone_source(part: Any) -> str:
    """Return the Python source of the module that defines `part`, with package imports replaced by local ones."""
    text = inspect.getsource(sys.modules[part.__module__])
    return re.sub(r"^from (?:\.+|slidax\.)[\w.]*?(\w+) import", r"from \1 import", text, flags=re.MULTILINE)


def _stem(part: Any) -> str:
    name: str = part.__module__
    return name.rpartition(".")[2]


FRANKA = RobotTarget(
    name="a Franka arm",
    joints=7,
    period=1e-3,
    lost=20,  # the robot's own rule
    folder="franka",
    files={"main.cpp.j2": "main.cpp", "CMakeLists.txt.j2": "CMakeLists.txt", "README.md.j2": "README.md"},
    program=run_franka,
)

export_franka = partial(export_robot, FRANKA)
"""Write programs for libfranka (C++) and pylibfranka (Python), and the law that both run: see `export_robot`."""


UNIVERSAL_ROBOTS = RobotTarget(
    name="a Universal Robots arm",
    joints=6,
    period=2e-3,
    lost=10,  # the robot leaves torque control as soon as commands stop
    folder="ur",
    files={"README.md.j2": "README.md"},
    program=run_ur,
)

export_ur = partial(export_robot, UNIVERSAL_ROBOTS)
"""Write a program for ur_rtde, and the law that it runs: see `export_robot`."""
