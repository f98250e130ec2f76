"""A scenario's law as a C project: library, header, tests, latency benchmark and example."""

from __future__ import annotations

import inspect
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import slidax
from slidax.codegen.c.expressions import Dialect, Helpers
from slidax.codegen.ir import Loop, functions
from slidax.codegen.passes import NO_OPERATIONS, OperationCount, count_iterations, count_operations
from slidax.core.errors import DefinitionError
from slidax.core.writing import error_reason, write_text
from slidax.law.sampled.controller import SampledData

from .c_source import CALLS, FunctionBody, StepSource, StreamCode, function_body, step_source
from .c_structures import Member, comment, render
from .golden_samples import GoldenSamples, golden_samples
from .guarded_step import GuardedStep, guarded_law, own_plant
from .programs import (
    StepPrograms,
    arm_program,
    has_float_constants,
    measurement,
    motion_program,
    references,
    step_programs,
)
from .status import ANSWERED, CHECKED, CONDITIONS, HELD, WAITING, Condition


@dataclass(frozen=True)
class JointUnits:
    """The name of a joint, and the units of its position, velocity and torque."""

    name: str
    q: str
    dq: str
    tau: str


@dataclass(frozen=True)
class CProject:
    """An exported law: the data for the templates of the C project.

    - `name`: name of the law in C.
    - `title`: title of the scenario, one line.
    - `law`: names of scheme and robot, one line.
    - `command`: the command line of the export.
    - `joints`: names and units of the joints.
    - `dialect`: number type of the C code.
    - `guard`: the law with its checks, as a Python object; one call of it computes one sample.
    - `step`, `source`: the functions of `guard` as lists of scalar operations, and as C source.
    - `motion`, `arm`: bodies of the C functions for the scenario's reference and for the arm's acceleration.
    - `scenario_helpers`: lines of the small functions that `motion` and `arm` call.
    - `tables`: long constant arrays that `motion` and `arm` read.
    - `stream`: the filter of streamed positions in C; None if the scenario's motion is not streamed.
    - `golden`: golden samples, which are inputs of the step with its expected results; None without tests.
    - `period`, `t1`: sample time and end time of the scenario [s].
    - `delay`: delay of sensor and actuator together, in whole periods.
    - `start`: initial positions [n] and velocities [n] of the joints.
    """

    name: str
    title: str
    law: str
    command: str
    joints: tuple[JointUnits, ...]
    dialect: Dialect
    guard: GuardedStep
    step: StepPrograms
    source: StepSource
    motion: FunctionBody
    arm: FunctionBody
    scenario_helpers: list[str]
    tables: list[Member]
    stream: StreamCode | None
    golden: GoldenSamples | None
    period: float
    t1: float
    delay: int
    start: tuple[list[float], list[float]]

    version = slidax.__version__
    checked = CHECKED
    waiting = WAITING
    answered = ANSWERED
    conditions = CONDITIONS
    held = HELD

    def __repr__(self) -> str:
        return f"C project `{self.name}`: {self.law} in {self.real}s, at most {self.stack} bytes of stack"

    @property
    def prefix(self) -> str:
        """Prefix of all types and functions in C."""
        return f"slidax_{self.name}"

    @property
    def macro(self) -> str:
        """Prefix of all macros in C."""
        return self.prefix.upper()

    @property
    def real(self) -> str:
        """Number type in C: double or float."""
        return self.dialect.real

    @property
    def stack(self) -> int:
        """Upper bound of a step's stack [bytes]."""
        return self.source.bytes

    @property
    def calls(self) -> int:
        """Part of `stack` that is reserved for calls [bytes]."""
        return CALLS[self.dialect.real]

    @property
    def read_names(self) -> list[str]:
        """The inputs that the law reads, by their names in C."""
        names = {"state.": "measurement.", "now.": "reference.", "next.": "reference."}
        inputs = ["measurement.t"]
        for name in sorted(self.guard.reads, reverse=True):
            before, _, part = name.partition(".")
            inputs.append(f"{names[before + '.']}{part}{'_next' if before == 'next' else ''}")
        return inputs

    @property
    def read_flags(self) -> str:
        """C initialiser of flags, one per number in q and dq, then one for t: true if the law reads the number."""
        n = len(self.joints)
        flags = [name in self.guard.reads for name in ("state.q", "state.dq") for _ in range(n)] + [True]
        return ", ".join("true" if flag else "false" for flag in flags)

    @property
    def bounds_velocity(self) -> bool:
        """True if measured velocities must be in range; False if the law's estimator does not read them."""
        law = self.guard.controller
        return not isinstance(law, SampledData) or law.estimator.reads_velocity

    @property
    def golden_is_close(self) -> bool:
        """True if the C test compares all results; False for a law in floats with other constants than in Python."""
        return self.real == "double" or has_float_constants(self.step.answered.program)

    @property
    def shown_parameter(self) -> str:
        """C expression of the parameter in the README's example."""
        names = [member.element(0) for member in self.parameters if not member.name.startswith("nominal")]
        return next((name for name in names if name.startswith(("surface_", "k"))), names[0])

    @property
    def longest(self) -> OperationCount | None:
        """Upper bound of the number of operations in one step; None if a loop's number of iterations has no bound."""
        step = self.step
        each = [
            count_operations(part.program) for part in (step.checked, step.begun, step.held, step.valid, step.answered)
        ]
        return None if None in each else sum((bound for bound in each if bound), NO_OPERATIONS)

    @property
    def longest_text(self) -> str:
        """The bound of a step's operations in words."""
        program = self.step.answered.program
        every = [value for part in (*functions(program), program) for value in part.walk() if isinstance(value, Loop)]
        most = sorted({count for loop in every if (count := count_iterations(loop)) is not None}, reverse=True)
        loops = f"its loops take at most {' or '.join(map(str, most))} turns" if most else "it has no loops"
        if self.longest is None:
            return loops
        return f"{loops},\nand its operations are never more than {self.longest}"

    @property
    def law_words(self) -> str:
        """Scheme and robot, and the first sentence of the law's docstring."""
        law = type(self.guard.controller)
        first = " ".join((inspect.getdoc(law) or "").split("\n\n")[0].split())
        return f"{self.law}. {law.__name__}: {comment(first)}"

    @property
    def period_ns(self) -> int:
        return round(1e9 * self.period)

    @property
    def period_text(self) -> str:
        return f"{1e3 * self.period:g} ms"

    @property
    def parameters(self) -> list[Member]:
        return self.step.parameters

    @property
    def ranges(self) -> list[str]:
        """C arguments for a range check by `within`, one text per parameter: address, count, lower and upper bound."""
        pairs = zip(self.step.parameters, self.step.bounds, strict=True)
        return [
            ", ".join((self.address("parameters->", member), str(member.size), *map(self._bound, bounds)))
            for member, bounds in pairs
            if bounds is not None
        ]

    def _bound(self, number: float) -> str:
        if math.isinf(number):
            return "INFINITY" if number > 0 else "-INFINITY"
        info, prefix = (np.finfo(np.float64), "DBL") if self.real == "double" else (np.finfo(np.float32), "FLT")
        names = {float(info.max): f"{prefix}_MAX", float(info.tiny): f"{prefix}_MIN"}
        sign = "-" if number < 0 else ""
        return f"{sign}{names[abs(number)]}" if abs(number) in names else self.literal(number)

    @property
    def memory(self) -> list[Member]:
        return self.step.memory

    @property
    def workspace(self) -> list[Member]:
        """Members of the workspace, the C structure for values that depend only on the parameters."""
        return self.source.workspace

    @property
    def outputs(self) -> list[Member]:
        """Members of the C structure of a command: torques and signals."""
        units = units_text([joint.tau for joint in self.joints])
        return [Member("tau", "f64", (len(self.joints),), f"torques [{units}]"), *self.step.signals]

    @property
    def measurement(self) -> list[Member]:
        return self._marked(measurement(len(self.joints)), {"q": "state.q", "dq": "state.dq"})

    @property
    def reference(self) -> list[Member]:
        names = {part: f"now.{part}" for part in ("q", "dq", "ddq")}
        names |= {f"{part}_next": f"next.{part}" for part in ("q", "dq", "ddq")}
        return self._marked(references(len(self.joints)), names)

    def bits(self, conditions: Iterable[Condition]) -> str:
        """Return the C expression of a status: the sum of the bits of those `conditions` whose C variable is true."""
        flags = (f"({each.name.lower()} ? {self.macro}_{each.name} : 0u)" for each in conditions)
        return "\n        | ".join(flags)

    def literal(self, number: float) -> str:
        """Return a number as C source text."""
        return self.dialect.number(number, "f64")

    def call(self, name: str) -> str:
        """Return the name of a `math.h` function for the project's number type: `sin` or `sinf` for `name` "sin"."""
        return self.dialect.function(name, "f64")

    def address(self, pointer: str, member: Member) -> str:
        """Return the C expression for the address of a structure member's first number.

        - `pointer`: C text before the member's name, such as `parameters->`.
        """
        return f"{pointer}{member.name}" if member.shape else f"&{pointer}{member.name}"

    @property
    def huge(self) -> str:
        """A number near the largest finite number, as C source text."""
        return "1e308" if self.real == "double" else "1e38f"

    @property
    def denormal(self) -> str:
        """The smallest positive number, as C source text."""
        return "0x1p-1074" if self.real == "double" else "0x1p-149f"

    def initialiser(self, row: int) -> str:
        """Return the golden sample with the index `row` as a C initialiser."""
        assert self.golden is not None
        parts = (self.measurement, self.reference, self.memory, self.outputs, self.memory)
        structs = (
            ", ".join(self._written(number, member) for number, member in zip(numbers, members, strict=True))
            for numbers, members in zip(self.golden.rows[row], parts, strict=True)
        )
        inside = ", ".join(f"{{{struct}}}" for struct in structs)
        # Two digits are enough for a tolerance.
        suffix = "" if self.real == "double" else "f"
        within = ", ".join(
            "{" + ", ".join(f"{number:.1e}{suffix}" for number in part) + "}" for part in self.golden.within[row]
        )
        return f"{{{inside}, {self.golden.statuses[row]}u, {within}}}"

    def _written(self, numbers: Any, member: Member) -> str:
        """Format numbers for C, doubles as hexadecimal so that no bit is lost."""
        if isinstance(numbers, list):
            return f"{{{', '.join(self._written(number, replace(member, shape=())) for number in numbers)}}}"
        if member.type != "f64" or not math.isfinite(numbers):
            return self.dialect.number(numbers, member.type)
        return hexadecimal(numbers) + ("" if self.real == "double" else "f")

    def _marked(self, members: list[Member], names: dict[str, str]) -> list[Member]:
        """Return the members with units in their meanings, and a note in those that the law does not read."""
        units = {"q": "", "dq": "/s", "ddq": "/s^2"}
        marked = []
        for member in members:
            meaning = member.meaning
            if member.shape:
                unit = units[member.name.removesuffix("_next")]
                meaning += f" [{units_text([joint.q + unit for joint in self.joints])}]"
            if names.get(member.name, "") not in {*self.guard.reads, ""}:
                meaning += "; not read by this law, may be anything"
            marked.append(replace(member, meaning=meaning))
        return marked


def units_text(units: Sequence[str]) -> str:
    """Return the units of all joints; a single unit if all are equal."""
    return units[0] if len(set(units)) == 1 else ", ".join(units)


def hexadecimal(number: float) -> str:
    """Return a finite number in C's hexadecimal notation, without trailing zeros."""
    return re.sub(r"\.?0*p", "p", number.hex()).replace("p+", "p")


if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

LONGEST_NAME = 40
FILES = {
    "header.h.j2": "{prefix}.h",
    "step.c.j2": "{prefix}.c",
    "wrapper.hpp.j2": "{prefix}.hpp",
    "flat.h.j2": "{prefix}_flat.h",
    "flat.c.j2": "{prefix}_flat.c",
    "scenario.h.j2": "{prefix}_scenario.h",
    "scenario.c.j2": "{prefix}_scenario.c",
    "golden.h.j2": "golden.h",
    "test.c.j2": "test_{name}.c",
    "latency.c.j2": "latency.c",
    "example.c.j2": "example.c",
    "CMakeLists.txt.j2": "CMakeLists.txt",
    "README.md.j2": "README.md",
    "clang-tidy.j2": ".clang-tidy",
}
"""Output file of each template."""

NEEDED = ("header.h", "step.c", "wrapper.hpp", "flat.h", "flat.c", "scenario.h", "scenario.c")
STEP = {f"{name}.j2": FILES[f"{name}.j2"] for name in NEEDED}
"""Output file of each template that a program needs: without tests, golden samples, example and build file."""

STREAM = {"stream.h.j2": "{prefix}_stream.h", "stream.c.j2": "{prefix}_stream.c"}
"""Output files of the additional templates for a law with a streamed reference."""


def export_c(
    scenario: Scenario,
    out: str | Path,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    golden: bool = True,
) -> CProject:
    """Write a scenario's law as a C project to the folder `out`; existing files of the same names are overwritten.

    - `name`: the law's name in C; by default the scenario's.
    - `single`: floats instead of doubles.
    - `command`: the command line, quoted in the file headers.
    - `golden`: include tests, golden samples, example and build file; the golden samples take most of the time.

    Raises DefinitionError if there is no native code for the law, the name is not valid in C, or the folder cannot be
    written.
    """
    exported = project(scenario, name=name, single=single, command=command, with_golden=golden)
    write_files(exported, out, (FILES if golden else STEP) | (STREAM if exported.stream else {}))
    with writing(out):
        write_text(Path(out, "law.json"), json.dumps(describe_law(exported), indent=1) + "\n")
    return exported


def describe_law(exported: CProject) -> dict[str, Any]:
    """Return the content of `law.json`: names, units, timing, structures and status bits, for other languages."""
    return {
        "name": exported.name,
        "prefix": exported.prefix,
        "title": exported.title,
        "law": exported.law,
        "real": exported.real,
        "joints": len(exported.joints),
        "units": [joint.q for joint in exported.joints],
        "torque_units": [joint.tau for joint in exported.joints],
        "period": exported.period,
        "t1": exported.t1,
        "delay": exported.delay,
        "streams": exported.stream is not None,
        "version": exported.version,
        "structures": {
            "parameters": _described(exported.parameters, exported),
            "reference": _described(exported.reference, exported),
            "command": _described(exported.outputs, exported),
        },
        "conditions": [{"name": each.name, "bit": each.bit, "meaning": each.meaning} for each in exported.conditions],
    }


def _described(these: list[Member], exported: CProject) -> list[dict[str, Any]]:
    return [
        {
            "name": each.name,
            "type": exported.dialect.type(each.type),
            "size": each.size if each.shape else 0,
            "meaning": each.meaning,
        }
        for each in these
    ]


def write_files(exported: CProject, out: str | Path, templates: Mapping[str, str], **values: Any) -> None:
    """Write files from templates to the folder `out`.

    - `templates`: output file of each template; `{prefix}` and `{name}` stand for the law's prefix and name.
    - `values`: further variables of the templates; they can also read the exported law, as `x`.

    Raises DefinitionError if the folder cannot be written.
    """
    with writing(out):
        for template, file in templates.items():
            path = Path(out, file.format(prefix=exported.prefix, name=exported.name))
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, render(template, {"x": exported, **values}))


@contextmanager
def writing(out: str | Path) -> Iterator[None]:
    """Create the folder `out`; raise DefinitionError if it, or a file in the `with` block, cannot be written."""
    try:
        Path(out).mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise DefinitionError(f"cannot write the project to `{out}`: {error_reason(error)}") from None


def project(
    scenario: Scenario,
    *,
    name: str | None = None,
    single: bool = False,
    command: str = "",
    with_golden: bool = True,
) -> CProject:
    """Return a scenario's law as a `CProject` in memory; `export_c` writes it to files.

    - `with_golden`: include golden samples, which take most of the time; other arguments as in `export_c`.

    Raises DefinitionError if there is no native code for the law, or the name is not valid in C.
    """
    name = _checked_name(scenario.name if name is None else name, clean=name is None)
    plant, guard = own_plant(scenario), guarded_law(scenario)
    described, robot = scenario.description, plant.robot
    dialect = Dialect("float" if single else "double")
    step = step_programs(guard, dialect.real)
    same = not single or has_float_constants(step.answered.program)
    helpers = Helpers(dialect)
    of_motion, of_arm = motion_program(scenario.trajectory, robot.joints), arm_program(plant)
    motion = function_body(of_motion, dialect, ("t", "period", "reference"), helpers)
    arm = function_body(of_arm, dialect, ("t", "q", "dq", "tau", "ddq"), helpers)
    return CProject(
        name=name,
        title=comment(described.title),
        law=f"{scenario.scheme} on {scenario.robot}",
        command=command,
        joints=tuple(
            JointUnits(comment(joint), unit, f"{unit}/s", torque)
            for joint, unit, torque in zip(robot.joint_names, robot.joint_units, robot.torque_units, strict=True)
        ),
        dialect=dialect,
        guard=guard,
        step=step,
        source=step_source(step, dialect),
        motion=motion,
        arm=arm,
        scenario_helpers=helpers.lines,
        tables=[*of_motion.tables, *of_arm.tables],
        stream=StreamCode.of(scenario.trajectory, robot.joints, dialect),
        golden=golden_samples(scenario, guard, dialect.real, same=same) if with_golden else None,
        period=scenario.period,
        t1=scenario.t1,
        delay=described.timing.whole_periods,
        start=(scenario.state0.q.tolist(), scenario.state0.dq.tolist()),
    )


def _checked_name(name: str, *, clean: bool) -> str:
    cleaned = re.sub(r"\W+", "_", comment(name)).strip("_").lower() if clean else name
    if not re.fullmatch(r"[a-z][a-z0-9_]*", cleaned) or len(cleaned) > LONGEST_NAME:
        raise DefinitionError(
            f"`{cleaned}` cannot be the law's name in C: set `--name NAME`, at most {LONGEST_NAME} small letters, "
            f"digits and _, beginning with a letter"
        )
    return cleaned
