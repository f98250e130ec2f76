"""Programs of the exported functions: step, envelope, reference motion, stream filter and arm.

A program is a function as a list of scalar operations (`slidax.codegen.ir.Program`). To trace a JAX function is to
record its operations in a program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.codegen.builder import Builder
from slidax.codegen.ir import Program, Value
from slidax.codegen.passes import rebuild
from slidax.codegen.trace.library import Library
from slidax.codegen.trace.tracing import ir_type, trace
from slidax.core.linear_algebra import matvec
from slidax.core.types import Reference, Scalar, State, Vector
from slidax.motions.stream import StreamFilter
from slidax.motions.trajectory import AbstractMotion
from slidax.simulation.plant import Plant

from .c_structures import Member, ParameterBounds, constant_bounds, members, related_valid
from .guarded_step import GuardedStep
from .status import ANSWERED, CHECKED, WAITING, Condition, Flag, StepMemory

LONG = 64
"""Smallest number of elements of an array that becomes a table in C."""

CHANGED = ("tau", "held", "stop", "commanded")
"""Members of the memory that a step with a held command changes."""

SAMPLE = ("", "t", "", "reference", "next")
"""Names of a step's arguments in C comments: parameters, time, state, reference now and one period later."""


@dataclass(frozen=True)
class CArray:
    """A variable or structure member in C.

    - `pointer`: C text before the member's name, such as `parameters->`; empty for a variable.
    - `member`: name, type and shape.
    """

    pointer: str
    member: Member

    def element(self, k: int | str) -> str:
        """Return the C expression of the number at index `k`, which is an integer or a C expression."""
        return f"{self.pointer}{self.member.name}[{k}]" if self.member.shape else f"{self.pointer}{self.member.name}"


@dataclass(frozen=True)
class Function:
    """A program, with the C variable or structure member that holds each of its inputs and outputs."""

    program: Program
    inputs: list[CArray]
    outputs: list[CArray]

    def read(self, which: int, element: int | str) -> str:
        """Return the C expression that reads an input's element; `which` is the input's index."""
        return self.inputs[which].element(element)

    @property
    def local(self) -> list[str]:
        """Names of the outputs that are C variables."""
        return [array.member.name for array in self.outputs if not array.pointer]

    @property
    def tables(self) -> list[Member]:
        """Constant arrays that the program reads."""
        read = {value.data[0] for value in self.program.body.values if value.op == "input"}
        read |= {value.data for value in self.program.walk() if value.op == "load"}
        return [
            array.member
            for k, array in enumerate(self.inputs)
            if not array.pointer and array.member.values is not None and k in read
        ]

    @property
    def assigned(self) -> list[tuple[str, Value]]:
        """C lvalue of each element of all outputs, with its value."""
        return [
            (array.element(k), value)
            for array, output in zip(self.outputs, self.program.outputs, strict=True)
            for k, value in enumerate(output.values or ())
        ]


@dataclass(frozen=True)
class StepPrograms:
    """All traced functions of a guarded step.

    - `checked`: function that detects the faults of a sample.
    - `answered`: function that computes the command for a good sample.
    - `held`: function that holds the command at a bad sample.
    - `begun`: function that computes the memory at the first good sample.
    - `valid`: function that checks parameters whose ranges depend on other parameters.
    - `parameters`, `memory`, `signals`: members of the C structures for parameters, memory and signals.
    - `bounds`: smallest and largest allowed value of each parameter; None for integers and booleans.
    """

    checked: Function
    answered: Function
    held: Function
    begun: Function
    valid: Function
    parameters: list[Member]
    bounds: list[ParameterBounds | None]
    memory: list[Member]
    signals: list[Member]


def step_programs(guard: GuardedStep, real: str = "double") -> StepPrograms:
    """Trace the functions of a guarded step, and return their programs, from which C code is written.

    - `guard`: the step; its parameters have the default values of the exported law.
    - `real`: number type in C, "double" or "float".

    Raises DefinitionError if there is no native code for the law.
    """
    t, state, reference = _sample(guard.joints)
    held = jax.eval_shape(guard.init, t, state, reference)
    parameters = members(guard, strip=("controller", "step", "law"), values=True)
    memory = members(held)
    by_name = {member.name: member for member in memory}

    def checked(guard: GuardedStep, t: Scalar, state: State, now: Reference, following: Reference) -> list[Flag]:
        return list(guard.checked(t, state, now, following).values())

    def answered(
        guard: GuardedStep, memory: StepMemory, t: Scalar, state: State, now: Reference, following: Reference
    ) -> tuple[StepMemory, dict[str, Any], list[Flag]]:
        command, flags = guard.answered(t, state, now, following, memory)
        return command.memory, command.signals, list(flags.values())

    def hold(guard: GuardedStep, memory: StepMemory) -> tuple[list[Any], list[Flag]]:
        kept, flags = guard.held(memory)
        return [getattr(kept, name) for name in CHANGED], list(flags.values())

    def begin(guard: GuardedStep, memory: StepMemory, t: Scalar, state: State, now: Reference) -> StepMemory:
        return guard.begun(t, state, now, memory)

    sample = (t, state, reference, reference)
    signals = members(jax.eval_shape(answered, guard, held, *sample)[1])
    settings, kept = _arrays("parameters->", parameters), _arrays("memory->", memory)
    sensors = _arrays("measurement->", measurement(guard.joints))
    wanted, out = _arrays("reference->", references(guard.joints)), _arrays("command->", signals)
    library = Library()
    return StepPrograms(
        checked=_function(checked, (guard, *sample), SAMPLE, settings + sensors + wanted, _flags(CHECKED)),
        answered=_function(
            answered,
            (guard, held, *sample),
            (SAMPLE[0], "memory", *SAMPLE[1:]),
            settings + kept + sensors + wanted,
            kept + out + _flags(ANSWERED),
            library,
        ),
        held=_function(
            hold,
            (guard, held),
            ("", "memory"),
            settings + kept,
            _arrays("memory->", [by_name[name] for name in CHANGED]) + _flags(WAITING),
        ),
        begun=_function(
            begin,
            (guard, held, *sample[:3]),
            (SAMPLE[0], "memory", *SAMPLE[1:4]),
            settings + kept + sensors + wanted[:3],
            kept,
            library,
        ),
        valid=_function(related_valid, (guard,), ("",), settings, [CArray("", Member("valid", "b1", ()))]),
        parameters=parameters,
        bounds=constant_bounds(guard, real),
        memory=memory,
        signals=signals,
    )


def motion_program(trajectory: AbstractMotion, joints: int) -> Function:
    """Trace a reference motion: from time and sample time [s] to the reference now and one period later.

    Long constant arrays become tables in C.
    """
    long, short = _tables(trajectory)

    def motion(t: Scalar, period: Scalar, long: Any) -> tuple[Reference, Reference]:
        whole = eqx.combine(long, short)
        return whole.reference(t), whole.reference(t + period)

    number = jnp.zeros(())
    inputs = [CArray("", Member(name, "f64", ())) for name in ("t", "period")] + _arrays(
        "", _table_members(long, "motion")
    )
    outputs = _arrays("reference->", references(joints))
    return _function(motion, (number, number, long), ("t", "period", "table"), inputs, outputs)


def arm_program(plant: Plant) -> Function:
    """Trace the arm's dynamics in a plant, with disturbances: from time, state and torque to the accelerations [n]."""
    long, short = _tables(plant)

    def acceleration(t: Scalar, state: State, tau: Vector, long: Any) -> Vector:
        return eqx.combine(long, short).acceleration(t, state, tau)

    t, state, _ = _sample(plant.robot.joints)
    shape = state.q.shape
    inputs = [
        CArray("", Member("t", "f64", ())),
        *(CArray("", Member(name, "f64", shape)) for name in ("q", "dq", "tau")),
        *_arrays("", _table_members(long, "arm")),
    ]
    outputs = [CArray("", Member("ddq", "f64", shape))]
    return _function(acceleration, (t, state, state.q, long), ("t", "", "tau", "table"), inputs, outputs)


def stream_program(stream: StreamFilter, joints: int) -> tuple[Function, list[Member], list[Member]]:
    """Trace the filter of streamed positions; return its step, the members of its options, and those of its state."""
    names = ("bandwidth", "velocity", "acceleration", "jerk", "lower", "upper")
    wide = [jnp.broadcast_to(getattr(stream, name), (joints,)) for name in names]
    stream = eqx.tree_at(lambda part: [getattr(part, name) for name in names], stream, wide)
    vector = jnp.zeros(joints)
    state = stream.begin(vector)
    options, kept = members(stream, values=True), members(jax.eval_shape(lambda: state))
    inputs = [
        *_arrays("options->", options),
        *_arrays("stream->", kept),
        CArray("", Member("newest", "f64", (joints,))),
        CArray("", Member("fresh", "f64", ())),
    ]
    outputs = _arrays("reference->", references(joints)) + _arrays("stream->", kept)
    arguments = (stream, state, vector, jnp.zeros(()))
    step = _function(StreamFilter.step, arguments, ("options", "stream", "newest", "fresh"), inputs, outputs)
    return step, options, kept


def torque_program(guard: GuardedStep, step: StepPrograms, robot: AbstractRobot) -> Function:
    """Trace the nominal arm's inverse dynamics: from parameters, q, q̇ and q̈ to M(q) q̈ + C(q,q̇) q̇ + G(q) + F(q̇).

    - `robot`: the arm to use if the law has no nominal arm.
    """
    long, short = _tables(robot)

    def torque(guard: GuardedStep, q: Vector, dq: Vector, ddq: Vector, long: Any) -> Vector:
        arms = [each for each in jax.tree.leaves(guard, is_leaf=_is_robot) if _is_robot(each)]
        arm = arms[0] if arms else eqx.combine(long, short)
        return matvec(arm.mass(q), ddq) + arm.bias(q, dq) + arm.friction(dq)

    vector = jnp.zeros(guard.joints)
    inputs = [
        *_arrays("parameters->", step.parameters),
        *(CArray("", Member(name, "f64", vector.shape)) for name in ("q", "dq", "ddq")),
        *_arrays("", _table_members(long, "arm")),
    ]
    outputs = [CArray("", Member("tau", "f64", vector.shape))]
    return _function(torque, (guard, vector, vector, vector, long), ("", "q", "dq", "ddq", "table"), inputs, outputs)


def _is_robot(node: Any) -> bool:
    return isinstance(node, AbstractRobot)


def _tables(tree: Any) -> tuple[Any, Any]:
    """Split a tree into two of equal structure: its arrays with at least `LONG` elements, and all other leaves."""
    return eqx.partition(tree, lambda leaf: eqx.is_array(leaf) and leaf.size >= LONG)


def _table_members(long: Any, owner: str) -> list[Member]:
    """Return one member for each long array, whose values become a table in C."""
    return [
        Member(f"{owner}_table_{k}", ir_type(leaf.dtype, owner), tuple(leaf.shape), values=np.asarray(leaf))
        for k, leaf in enumerate(jax.tree.leaves(long), start=1)
    ]


def measurement(joints: int) -> list[Member]:
    """Return the members of the C structure of a measurement: time, positions, velocities."""
    return [
        Member("t", "f64", (), "time since the start of the motion [s]"),
        Member("q", "f64", (joints,), "positions"),
        Member("dq", "f64", (joints,), "velocities"),
    ]


def references(joints: int) -> list[Member]:
    """Return the members of the C structure of a reference: positions and derivatives, now and one period later."""
    words = {"q": "positions", "dq": "velocities", "ddq": "accelerations"}
    return [Member(name, "f64", (joints,), f"{word} now") for name, word in words.items()] + [
        Member(f"{name}_next", "f64", (joints,), f"{word} one period later") for name, word in words.items()
    ]


def _function(
    function: Callable[..., Any],
    args: tuple[Any, ...],
    names: tuple[str, ...],
    inputs: list[CArray],
    outputs: list[CArray],
    library: Library | None = None,
) -> Function:
    return Function(trace(function, *args, names=names, library=library), inputs, outputs)


def _arrays(pointer: str, members: list[Member]) -> list[CArray]:
    return [CArray(pointer, member) for member in members]


def _flags(conditions: tuple[Condition, ...]) -> list[CArray]:
    return [CArray("", Member(condition.name.lower(), "b1", ())) for condition in conditions]


def _sample(joints: int) -> tuple[Scalar, State, Reference]:
    vector = jnp.zeros(joints)
    return jnp.zeros(()), State(vector, vector), Reference(vector, vector, vector)


MEANINGS = {
    "error": "errors e",
    "lower": "lower bounds of the errors",
    "upper": "upper bounds of the errors",
    "margin": "distance of the errors to the nearer bound, as a share of the envelope's width; below 0 outside",
}


def envelope_members(joints: int) -> list[Member]:
    """Return the members of the C structure with errors, bounds and margins of the envelope."""
    return [Member(name, "f64", (joints,), meaning) for name, meaning in MEANINGS.items()]


def envelope_function(guard: GuardedStep, step: StepPrograms) -> Function | None:
    """Trace the tracking errors, and the bounds and margins of the envelope, per joint.

    The program's inputs are the parameters, the memory before a step, the measurement and the reference.

    Returns None if the law has no envelope. Raises DefinitionError if there is no native code for the envelope.
    """
    t, state, reference = _sample(guard.joints)
    memory = jax.eval_shape(guard.init, t, state, reference)
    if jax.eval_shape(guard.envelope, t, memory) is None:
        return None

    def envelope(guard: GuardedStep, memory: StepMemory, t: Scalar, state: State, now: Reference) -> list[Vector]:
        bounds = guard.envelope(t, memory)
        assert bounds is not None
        e = state.q - guard.wanted_then(now)
        lower, upper = (jnp.broadcast_to(bound, e.shape) for bound in (bounds.lower, bounds.upper))
        return [e, lower, upper, jnp.minimum(e - lower, upper - e) / (upper - lower)]

    inputs = _arrays("parameters->", step.parameters) + _arrays("memory->", step.memory)
    inputs += _arrays("measurement->", measurement(guard.joints))
    inputs += _arrays("reference->", references(guard.joints)[:3])
    outputs = _arrays("envelope->", envelope_members(guard.joints))
    names = ("", "memory", "t", "", "reference")
    return _function(envelope, (guard, memory, t, state, reference), names, inputs, outputs)


DOUBLE, FLOAT = float(np.finfo(np.float64).eps), float(np.finfo(np.float32).eps)
TOLERANCES = (0.1 * DOUBLE, 1e-10)
"""Range of constants that are tolerances: gains are larger, and guards against division by zero are far smaller."""

ULPS = 16.0
"""Largest tolerance in floats, in units in the last place; a search meets this tolerance easily."""

FEWEST = 4.0
"""Smallest tolerance in floats, in units in the last place; the rounding of a sum would exceed a smaller one."""

NEXT_TO_ONE = 4.0 * FLOAT
"""Distance from 1 in floats for constants that are next to 1 in doubles."""


def with_float_constants(program: Program) -> Program:
    """Return a program whose constants are adapted from doubles to floats.

    A constant that is the tolerance of a search keeps its size in units in the last place, within 4 to 16 of them, so
    that the search can meet it. A constant next to 1 (it keeps a logarithm finite) stays different from 1 in floats.
    Other constants are unchanged.
    """

    def replaced(builder: Builder, value: Value, args: tuple[Value, ...]) -> Value | None:
        fitted = tuple(
            builder.constant(float_constant(arg.data), "f64") if arg.op == "const" and arg.type == "f64" else arg
            for arg in args
        )
        if all(new is old for new, old in zip(fitted, args, strict=True)):
            return None
        return builder.apply(value.op, *fitted, type=value.type, data=value.data)

    return rebuild(program, replaced)


def has_float_constants(program: Program) -> bool:
    """True if a program's constants suit floats as well as doubles: `with_float_constants` would change none."""
    return all(
        float_constant(value.data) == value.data
        for value in program.walk()
        if value.op == "const" and value.type == "f64"
    )


def float_constant(number: float) -> float:
    """Return the constant for floats that replaces a constant for doubles; the number itself if it suits both."""
    size = abs(number)
    if TOLERANCES[0] < size < TOLERANCES[1]:
        return float(np.copysign(min(max(size / DOUBLE, FEWEST), ULPS) * FLOAT, number))
    if 0.0 < abs(size - 1.0) < NEXT_TO_ONE:
        return float(np.copysign(1.0 + np.copysign(NEXT_TO_ONE, size - 1.0), number))
    return number
