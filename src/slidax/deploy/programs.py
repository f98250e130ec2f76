"""Programs of the exported functions, with the name of each of their arrays in C."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Reference, Scalar, State, Vector
from slidax.codegen.ir import Program, Value
from slidax.codegen.trace import Library, trace
from slidax.codegen.trace.trace import ir_type
from slidax.simulation import Plant
from slidax.trajectories import AbstractTrajectory

from .guarded_step import GuardedStep
from .members import Member, members
from .status import ANSWERED, CHECKED, WAITING, Condition
from .step_memory import Flag, StepMemory
from .validity import Bounds, constant_bounds, related_valid

LONG = 64
"""Numbers from which on an array becomes a table."""

CHANGED = ("tau", "held", "stop", "commanded")
"""Members of the memory that a held command changes."""

SAMPLE = ("", "t", "", "reference", "next")
"""Names of a step's arguments in comments: parameters, time, state, reference now and next."""


@dataclass(frozen=True)
class Place:
    """An array in C; `pointer`, such as `parameters->`, leads to its member."""

    pointer: str
    member: Member

    def element(self, k: int | str) -> str:
        """C expression of the number at index `k`, a number or an expression."""
        return f"{self.pointer}{self.member.name}[{k}]" if self.member.shape else f"{self.pointer}{self.member.name}"


@dataclass(frozen=True)
class Function:
    """A program with one place for each input and output."""

    program: Program
    inputs: list[Place]
    outputs: list[Place]

    def read(self, which: int, element: int | str) -> str:
        """C expression of an input's element."""
        return self.inputs[which].element(element)

    @property
    def tables(self) -> list[Member]:
        """The constant arrays that it reads."""
        read = {value.data[0] for value in self.program.body.values if value.op == "input"}
        read |= {value.data for value in self.program.walk() if value.op == "load"}
        return [place.member for k, place in enumerate(self.inputs) if place.member.values is not None and k in read]

    @property
    def assigned(self) -> list[tuple[str, Value]]:
        """Each element of an output, with its value."""
        return [
            (place.element(k), value)
            for place, output in zip(self.outputs, self.program.outputs, strict=True)
            for k, value in enumerate(output.values or ())
        ]


@dataclass(frozen=True)
class Step:
    """All functions of a guarded step.

    - `checked`: from a sample to its faults.
    - `answered`: the law on a good sample.
    - `held`: the command on a bad one.
    - `begun`: from the first good sample to the memory.
    - `valid`: from the parameters to true if those with ranges that depend on other parameters are in range.
    - `parameters`, `memory`, `signals`: members of the structures.
    - `bounds`: of the numbers of each parameter; None for one that is no real number.
    """

    checked: Function
    answered: Function
    held: Function
    begun: Function
    valid: Function
    parameters: list[Member]
    bounds: list[Bounds | None]
    memory: list[Member]
    signals: list[Member]


def step_programs(guard: GuardedStep, real: str = "double") -> Step:
    """Trace the programs of a guarded step.

    - `guard`: the step, with the parameters' defaults.
    - `real`: number type in C, "double" or "float".

    Raises DefinitionError if there is no native code for the law.
    """
    t, state, reference = _sample(guard.joints)
    held = jax.eval_shape(guard.init, t, state, reference)
    parameters = members(guard, strip=("controller", "step", "law"), values=True)
    memory = members(held)

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

    def valid(guard: GuardedStep) -> Flag:
        return related_valid(guard)

    sample = (t, state, reference, reference)
    signals = members(jax.eval_shape(answered, guard, held, *sample)[1])
    settings, kept = _places("parameters->", parameters), _places("memory->", memory)
    sensors, wanted = (
        _places("measurement->", measurement(guard.joints)),
        _places("reference->", references(guard.joints)),
    )
    out = _places("command->", signals)
    library = Library()
    return Step(
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
            _places("memory->", [_named(memory, name) for name in CHANGED]) + _flags(WAITING),
        ),
        begun=_function(
            begin,
            (guard, held, *sample[:3]),
            (SAMPLE[0], "memory", *SAMPLE[1:4]),
            settings + kept + sensors + wanted[:3],
            kept,
            library,
        ),
        valid=_function(valid, (guard,), ("",), settings, [Place("", Member("valid", "b1", ()))]),
        parameters=parameters,
        bounds=constant_bounds(guard, real),
        memory=memory,
        signals=signals,
    )


def motion_program(trajectory: AbstractTrajectory, joints: int) -> Function:
    """Trace the scenario's reference as a function of time and period; long constant arrays become tables."""
    long, short = _tables(trajectory)

    def motion(t: Scalar, period: Scalar, long: Any) -> tuple[Reference, Reference]:
        whole = eqx.combine(long, short)
        return whole.reference(t), whole.reference(t + period)

    number = jnp.zeros(())
    inputs = [Place("", Member(name, "f64", ())) for name in ("t", "period")] + _places("", _tabled(long, "motion"))
    outputs = _places("reference->", references(joints))
    return _function(motion, (number, number, long), ("t", "period", "table"), inputs, outputs)


def arm_program(plant: Plant) -> Function:
    """Trace the acceleration of the scenario's disturbed arm as a function of time, state and torque."""
    long, short = _tables(plant)

    def acceleration(t: Scalar, state: State, tau: Vector, long: Any) -> Vector:
        return eqx.combine(long, short).acceleration(t, state, tau)

    t, state, _ = _sample(plant.robot.joints)
    shape = state.q.shape
    inputs = [
        Place("", Member("t", "f64", ())),
        *(Place("", Member(name, "f64", shape)) for name in ("q", "dq", "tau")),
        *_places("", _tabled(long, "arm")),
    ]
    outputs = [Place("", Member("ddq", "f64", shape))]
    return _function(acceleration, (t, state, state.q, long), ("t", "", "tau", "table"), inputs, outputs)


def _tables(tree: Any) -> tuple[Any, Any]:
    """A tree's long arrays, and the rest of it."""
    return eqx.partition(tree, lambda leaf: eqx.is_array(leaf) and leaf.size >= LONG)


def _tabled(long: Any, owner: str) -> list[Member]:
    """The members of long arrays, with their numbers."""
    return [
        Member(f"{owner}_table_{k}", ir_type(leaf.dtype, owner), tuple(leaf.shape), values=np.asarray(leaf))
        for k, leaf in enumerate(jax.tree.leaves(long), start=1)
    ]


def measurement(joints: int) -> list[Member]:
    """The members of a measurement."""
    return [
        Member("t", "f64", (), "time since the start of the motion [s]"),
        Member("q", "f64", (joints,), "positions"),
        Member("dq", "f64", (joints,), "velocities"),
    ]


def references(joints: int) -> list[Member]:
    """The members of a reference: now, and one period later."""
    words = {"q": "positions", "dq": "velocities", "ddq": "accelerations"}
    return [Member(name, "f64", (joints,), f"{word} now") for name, word in words.items()] + [
        Member(f"{name}_next", "f64", (joints,), f"{word} one period later") for name, word in words.items()
    ]


def _function(
    function: Callable[..., Any],
    args: tuple[Any, ...],
    names: tuple[str, ...],
    inputs: list[Place],
    outputs: list[Place],
    library: Library | None = None,
) -> Function:
    return Function(trace(function, *args, names=names, library=library), inputs, outputs)


def _places(pointer: str, these: list[Member]) -> list[Place]:
    return [Place(pointer, member) for member in these]


def _flags(conditions: tuple[Condition, ...]) -> list[Place]:
    return [Place("", Member(condition.name.lower(), "b1", ())) for condition in conditions]


def _named(these: list[Member], name: str) -> Member:
    return next(member for member in these if member.name == name)


def _sample(joints: int) -> tuple[Scalar, State, Reference]:
    vector = jnp.zeros(joints)
    return jnp.zeros(()), State(vector, vector), Reference(vector, vector, vector)
