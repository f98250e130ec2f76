"""A scenario's guarded law as machine code: reference motion, step, and the row that a log has of each answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from slidax._errors import DefinitionError
from slidax._types import Reference, Scalar, State
from slidax.actuators import TorqueLimits
from slidax.logs import Channels
from slidax.realtime import Plan, Slot
from slidax.simulation import MujocoPlant

from ..guarded_step import GuardedStep
from ..status import CONDITIONS
from ..step_memory import StepMemory
from .planner import Planner, kernel

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

REFERENCE_COLUMNS = ("q_d", "dq_d", "ddq_d", "q_d_next", "dq_d_next", "ddq_d_next")
"""Now, and one period later."""

NUMBER, WHOLE = jax.ShapeDtypeStruct((), float), jax.ShapeDtypeStruct((), int)


@dataclass(frozen=True)
class LawPlan:
    """A law, ready to be called sample by sample.

    - `plan`: its code and memory.
    - `row`: the dtype of a row.
    - `sample`: the dtype of a row's inputs: time, measurement, reference.
    - `channels`: of its log.
    """

    plan: Plan
    row: np.dtype[Any]
    sample: np.dtype[Any]
    channels: Channels

    def columns(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Columns of rows (bytes, [m length]), by their names in a log."""
        table = np.ascontiguousarray(rows).view(self.row)[:, 0] if len(rows) else np.zeros(0, self.row)
        columns = {name: table[name] for name in self.row.names or ()}
        for place, name in enumerate(self.channels.bits):
            columns[name.lower()] = (columns["status"] >> place) & 1
        if self.channels.bounded:
            below, above = columns["e"] - columns["lower"], columns["upper"] - columns["e"]
            with np.errstate(invalid="ignore", divide="ignore"):
                columns["envelope_margin"] = np.minimum(below, above) / (columns["upper"] - columns["lower"])
        return columns


def require_samples(scenario: Scenario) -> None:
    """Raise DefinitionError if a scenario's law runs inside the integrator instead of at samples."""
    if scenario.stepping.mode != "held":
        raise DefinitionError(
            "a law that is called sample by sample needs held mode: `--set simulation.mode=held`, or a scenario "
            "such as example-4.1-1khz"
        )


def guarded(scenario: Scenario) -> GuardedStep:
    """A scenario's law behind its guards, as in `slidax export`."""
    plant = scenario.plant.own if isinstance(scenario.plant, MujocoPlant) else scenario.plant
    limits = TorqueLimits() if plant.actuator is None else plant.actuator.limits
    return GuardedStep.around(scenario.controller, limits, scenario.period)


def law_plan(scenario: Scenario) -> LawPlan:
    """Compile a scenario's law.

    Raises DefinitionError if the scenario is not in held mode, or llvmlite is not installed; NoNativeCodeError if there
    is no machine code for something in the law.
    """
    require_samples(scenario)
    guard = guarded(scenario)
    n = guard.joints
    vector = jax.ShapeDtypeStruct((n,), float)
    state, wanted = _state(vector), _reference(vector)
    planner = Planner()
    numbers = planner.place(guard)
    motion_numbers = planner.place(scenario.trajectory)
    period = planner.place(np.asarray(scenario.period))
    zeros = jax.eval_shape(guard.init, NUMBER, state, wanted)
    memories = [planner.place(zeros) for _ in range(2)]

    def motion(trajectory: Any, period: Scalar, t: Scalar) -> tuple[Reference, Reference]:
        return trajectory.reference(t), trajectory.reference(t + period)

    def step(
        guard: GuardedStep, memory: StepMemory, t: Scalar, state: State, now: Reference, following: Reference
    ) -> Any:
        command, status = guard.step(t, state, now, following, memory)
        envelope = guard.envelope(t, command.memory)
        bounds = () if envelope is None else (envelope.lower, envelope.upper)
        error = state.q - guard.wanted_then(now)
        return command.memory, (command.tau, command.signals, status, error, bounds)

    step_code, (_, shapes) = kernel(step, guard, zeros, NUMBER, state, wanted, wanted)
    motion_code, _ = kernel(motion, scenario.trajectory, NUMBER, NUMBER)

    fields: dict[str, Slot] = {name: planner.view(name, WHOLE) for name in ("k", "basis")}
    fields["t"] = planner.view("t", NUMBER)
    for name in ("q", "dq", "effort", *REFERENCE_COLUMNS):
        fields[name] = planner.view(name, vector)
    tau, signals, status, error, bounds = planner.place(shapes)
    fields |= {"tau": tau, "status": status, "e": error}
    fields |= dict(zip(("lower", "upper"), bounds, strict=False))
    fields |= {f"signal:{name}": slot for name, slot in signals.items()}
    for name in ("wake", "took", "response", "logged"):
        fields[name] = planner.view(name, NUMBER)
    planner.named("status", status)
    first, last = fields["k"], fields["logged"]
    for name, start, end in (
        ("row", first, last),
        ("measured", fields["q"], fields["effort"]),
        ("sample", fields["t"], fields[REFERENCE_COLUMNS[-1]]),
        ("tau", tau, tau),
    ):
        planner.region(name, start, end)
    references = [fields[name] for name in REFERENCE_COLUMNS]
    sample = (fields["t"], fields["q"], fields["dq"], *references)
    planner.code("motion", motion_code, (motion_numbers, period, fields["t"]), references)
    for at in range(2):
        answer = (memories[1 - at], (tau, signals, status, error, bounds))
        planner.code(f"step_{at}", step_code, (numbers, memories[at], *sample), answer)
    names = ("t", "q", "dq", "effort", *REFERENCE_COLUMNS)
    robot = scenario.plant.robot
    return LawPlan(
        plan=planner.plan(),
        row=dtype_of(fields, first, last),
        sample=dtype_of({name: fields[name] for name in names}, fields["t"], references[-1]),
        channels=Channels(
            joints=tuple(robot.joint_names),
            units=tuple(robot.joint_units),
            signals={name: slot.shape[0] if slot.shape else None for name, slot in signals.items()},
            bounded=bool(bounds),
            bits=tuple(condition.name for condition in CONDITIONS),
        ),
    )


def dtype_of(fields: dict[str, Slot], first: Slot, last: Slot) -> np.dtype[Any]:
    """The dtype of the region from `first` to `last` as a row."""
    return np.dtype(
        {
            "names": list(fields),
            "formats": [(slot.dtype, slot.shape) for slot in fields.values()],
            "offsets": [slot.offset - first.offset for slot in fields.values()],
            "itemsize": -(-(last.end - first.offset) // 8) * 8,
        }
    )


def _state(vector: Any) -> State:
    return jax.eval_shape(lambda q: State(q, q), vector)


def _reference(vector: Any) -> Reference:
    return jax.eval_shape(lambda q: Reference(q, q, q), vector)
